// Reports the failed tests with their errors, and the number of passed ones.

import { inspect } from "node:util";

export default async function* report(events) {
  let [passed, failed] = [0, 0];
  for await (const { type, data } of events) {
    if (type === "test:stdout" || type === "test:stderr") yield data.message;
    if (type === "test:pass") passed++;
    if (type !== "test:fail") continue;
    failed++;
    const { error } = data.details;
    yield `\n✖ ${data.name} (${data.file ?? ""}:${data.line ?? ""})\n${inspect(error.cause ?? error)}\n`;
  }
  yield `JavaScript: ${passed} passed, ${failed} failed\n`;
}
