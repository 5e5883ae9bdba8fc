/* A robot of another make, made with npm's `soap` from the descriptions that the components serve. It carries things in no time.
 *
 * node participant.js CONFIGURATION: JSON with `name`, `port`, `registry` (an address), `description` (the WSDL of a Service Manager), and, with
 * certificates, the files `certificate`, `key` and `authority`. Each message that comes is written to standard output, as a line of JSON.
 */

import { randomUUID } from "node:crypto";
import { readFileSync } from "node:fs";
import http from "node:http";
import https from "node:https";
import soap from "soap";

const WSA = "http://www.w3.org/2005/08/addressing";
const configuration = JSON.parse(process.argv[2]);
const files = configuration.certificate && {
  cert: readFileSync(configuration.certificate),
  key: readFileSync(configuration.key),
  ca: readFileSync(configuration.authority),
};
const agent = files && new https.Agent(files);
const own = `${files ? "https" : "http"}://127.0.0.1:${configuration.port}/devices/${configuration.name}`;
const clients = new Map();

/** A client for the component at an address, made from its description once. */
async function client(address) {
  if (!clients.has(address)) {
    const options = { forceSoap12Headers: true, wsdl_options: files ? { httpsAgent: agent } : {} };
    const made = await soap.createClientAsync(`${address}?wsdl`, options);
    if (files) made.setSecurity(new soap.ClientSSLSecurity(files.key, files.cert, files.ca));
    made.setEndpoint(address);
    clients.set(address, made);
  }
  return clients.get(address);
}

/** Send a message, and return what it is answered on the connection. */
async function send(address, name, body, relatesTo, namespace) {
  const sender = await client(address);
  sender.clearSoapHeaders();
  sender.addSoapHeader(
    `<wsa:To xmlns:wsa="${WSA}">${address}</wsa:To><wsa:From xmlns:wsa="${WSA}"><wsa:Address>${own}</wsa:Address></wsa:From>` +
      `<wsa:Action xmlns:wsa="${WSA}">${namespace}:${name}</wsa:Action><wsa:MessageID xmlns:wsa="${WSA}">urn:uuid:${randomUUID()}</wsa:MessageID>` +
      (relatesTo
        ? `<wsa:RelatesTo xmlns:wsa="${WSA}">${relatesTo}</wsa:RelatesTo><wsa:ReplyTo xmlns:wsa="${WSA}"><wsa:Address>${own}</wsa:Address></wsa:ReplyTo>`
        : ""),
  );
  const [answer] = await sender[`${name}Async`](body);
  return answer;
}

const text = (element) => (typeof element === "object" && element !== null ? element.$value : element);

/** What the participant does with each message of the Failure Recovery Protocol. Others need nothing. */
const ANSWERS = {
  Arrange: (body) => ["Terms", { Effect: body.Effect, Precondition: body.Precondition, Price: 0, Duration: 1 }],
  Execute: (body, work) => ["Completed", { Situation: work.effect }],
  Stop: () => ["Stopped", {}],
};
const works = new Map();

function operation(name) {
  return (body, answered, headers) => {
    process.stdout.write(`${JSON.stringify({ name, participant: body.Participant })}\n`);
    const coordinator = text((headers.ReplyTo || headers.From).Address);
    const session = { Transaction: body.Transaction, Participant: body.Participant, Version: "1.0" };
    if (name === "Arrange") works.set(body.Participant, { effect: body.Effect });
    const [kind, answer] = ANSWERS[name]?.(body, works.get(body.Participant)) ?? [];
    if (kind) {
      const message = Object.fromEntries(Object.entries({ ...session, ...answer }).filter(([, value]) => value !== undefined));
      send(coordinator, kind, message, text(headers.MessageID), "urn:so-mrs:frp:1.0").catch((error) => {
        process.stderr.write(`${kind}: ${error.message} ${error.body ?? ""}\n`);
      });
    }
    return {};
  };
}

const operations = Object.fromEntries(["Arrange", "Accept", "Execute", "Stop", "Cancel", "End", "Compensate"].map((name) => [name, operation(name)]));
const server = files ? https.createServer({ ...files, requestCert: true, rejectUnauthorized: true }) : http.createServer();
server.listen(configuration.port, "127.0.0.1", async () => {
  const description = readFileSync(configuration.description, "utf8");
  soap.listen(server, {
    path: `/devices/${configuration.name}`,
    services: { ServiceManager: { ServiceManagerPort: operations } },
    xml: description,
    uri: configuration.description,
    oneWay: { responseCode: 202, emptyBody: true },
    forceSoap12Headers: true,
    wsdl_options: files ? { httpsAgent: agent } : {},
  });
  const offer = {
    Service: `${configuration.name}.TransferObject`,
    Provider: configuration.name,
    ProviderType: "PioneerP3DX",
    Address: own,
    ServiceType: configuration.service,
  };
  const published = await send(configuration.registry, "Publish", { Provider: configuration.name, Offers: [offer], Lease: 600 }, "", "urn:so-mrs:directory:1.0");
  process.stdout.write(`${JSON.stringify({ published })}\n`);
});
