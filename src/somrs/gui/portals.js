// Quasar adds lists, menus, dialogs and tooltips to the end of the document. This moves them into the main landmark, and takes the options
// of a list out of an element that can have the focus, between which and the list no screen reader finds a relation.
//
// Quasar gives up placing a list that has no size for some 60 ms, as it may be on a busy machine, and never shows it. This has it placed
// again when it has a size: a menu follows the scrolling of what it belongs to.

const sizes = new ResizeObserver((entries) => {
  const isUnplaced = ({ target }) => target.offsetHeight > 0 && target.style.visibility !== "visible";
  if (!entries.some(isUnplaced)) return;
  for (const scrolled of [window, ...document.querySelectorAll(".scroll, .scroll-y, .overflow-auto")])
    scrolled.dispatchEvent(new Event("scroll"));
});

function moveIntoMain(portals) {
  document.querySelector("main")?.append(...portals);
  for (const portal of portals) {
    new MutationObserver(() => amend(portal)).observe(portal, { childList: true, subtree: true });
    amend(portal);
  }
}

function amend(portal) {
  for (const menu of portal.querySelectorAll(".q-menu")) sizes.observe(menu);
  for (const options of portal.querySelectorAll(".q-virtual-scroll__content[tabindex]")) options.removeAttribute("tabindex");
}

new MutationObserver((changes) => {
  const added = changes.flatMap(({ addedNodes }) => [...addedNodes]);
  moveIntoMain(added.filter((node) => node.id?.startsWith("q-portal--")));
}).observe(document.body, { childList: true });
