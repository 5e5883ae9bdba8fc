/* Fleet control of another make: the master controller of npm's `vda-5050-lib`, which speaks VDA 5050 2.0.
 *
 * node vda5050_master.js CONFIGURATION: JSON with `broker` (a URL), `interface`, `manufacturer`, `serialNumber` and `order`. It waits until
 * the vehicle is online, assigns the order, and writes what becomes of it to standard output, as lines of JSON.
 */

import vda5050 from "vda-5050-lib";

const configuration = JSON.parse(process.argv[2]);
const vehicle = { manufacturer: configuration.manufacturer, serialNumber: configuration.serialNumber };
const controller = new vda5050.MasterController(
  { interfaceName: configuration.interface, transport: { brokerUrl: configuration.broker }, vdaVersion: "2.0.0" },
  {},
);

/** Write what has happened. */
function tell(event) {
  process.stdout.write(`${JSON.stringify(event)}\n`);
}

await controller.start();
let isAssigned = false;
controller.trackAgvs((_, connectionState) => {
  if (connectionState !== "ONLINE" || isAssigned) return;
  isAssigned = true;
  controller.assignOrder(vehicle, configuration.order, {
    onOrderProcessed: (error, byCancelation, active) => tell({ event: "processed", error, byCancelation, active }),
    onNodeTraversed: (node) => tell({ event: "traversed", node: node.nodeId }),
    onActionStateChanged: (state) => tell({ event: "action", action: state.actionId, status: state.actionStatus }),
  });
});
tell({ event: "started" });
