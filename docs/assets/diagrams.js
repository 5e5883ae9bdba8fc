// Draws the diagrams of a page, in the page's colours, with the Mermaid that the site has beside it.
import { mermaid } from "./mermaid/index.js";

async function draw() {
  const dark = document.body.dataset.mdColorScheme === "slate";
  mermaid.initialize({ startOnLoad: false, theme: dark ? "dark" : "neutral" });
  for (const diagram of document.querySelectorAll("pre.diagram")) {
    diagram.dataset.source ??= diagram.textContent;
    const { svg } = await mermaid.render(`diagram-${crypto.randomUUID()}`, diagram.dataset.source);
    diagram.innerHTML = svg;
  }
}

await draw();
new MutationObserver(draw).observe(document.body, { attributeFilter: ["data-md-color-scheme"] });
