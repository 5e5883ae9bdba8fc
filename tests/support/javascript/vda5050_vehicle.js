/* A vehicle of another make: the virtual AGV of npm's `vda-5050-lib`, which speaks VDA 5050 2.0.
 *
 * node vda5050_vehicle.js CONFIGURATION: JSON with `broker` (a URL), `interface`, `manufacturer` and `serialNumber`.
 */

import vda5050 from "vda-5050-lib";

const configuration = JSON.parse(process.argv[2]);
const controller = new vda5050.AgvController(
  { manufacturer: configuration.manufacturer, serialNumber: configuration.serialNumber },
  { interfaceName: configuration.interface, transport: { brokerUrl: configuration.broker }, vdaVersion: "2.0.0" },
  { agvAdapterType: vda5050.VirtualAgvAdapter, publishStateInterval: 1000 },
  { initialPosition: { mapId: "hall", x: 0, y: 0, theta: 0, lastNodeId: "A" } },
);
await controller.start();
process.stdout.write("started\n");
