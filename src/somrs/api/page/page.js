// Shows the operations with Swagger UI, and adds what its elements lack for screen readers: a landmark, names, levels of headings,
// keyboard access.

const page = document.getElementById("api");
const root = page.dataset.root;

const LEVELS = { H3: 2, H4: 3, H5: 4 }; // Swagger UI has no headings of level 2

function amend() {
  page.querySelector(".information-container")?.setAttribute("role", "banner");
  for (const heading of page.querySelectorAll("h3, h4, h5")) heading.ariaLevel = LEVELS[heading.tagName];
  for (const field of page.querySelectorAll("tr[data-param-name] select")) field.ariaLabel = field.closest("tr").dataset.paramName;
  for (const body of page.querySelectorAll(".body-param__text")) body.ariaLabel = "Request body";
  for (const responses of page.querySelectorAll(".responses-table[role=region]")) responses.ariaLabel = `Responses of ${responses.id}`;
  for (const code of page.querySelectorAll("pre.microlight")) code.tabIndex = 0;
}

new MutationObserver(amend).observe(page, { childList: true, subtree: true });
window.SwaggerUIBundle({ url: `${root}/openapi.json`, dom_id: "#api", validatorUrl: null });
