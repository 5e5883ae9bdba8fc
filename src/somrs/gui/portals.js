// Quasar adds lists, menus, dialogs and tooltips to the end of the document. This moves them into the main landmark, and takes the options
// of a list out of an element that can have the focus, between which and the list no screen reader finds a relation.

function moveIntoMain(portals) {
  document.querySelector("main")?.append(...portals);
  for (const portal of portals) new MutationObserver(() => amend(portal)).observe(portal, { childList: true, subtree: true });
}

function amend(portal) {
  for (const options of portal.querySelectorAll(".q-virtual-scroll__content[tabindex]")) options.removeAttribute("tabindex");
}

new MutationObserver((changes) => {
  const added = changes.flatMap(({ addedNodes }) => [...addedNodes]);
  moveIntoMain(added.filter((node) => node.id?.startsWith("q-portal--")));
}).observe(document.body, { childList: true });
