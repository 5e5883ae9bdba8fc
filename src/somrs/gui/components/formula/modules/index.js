// The modules of the field for formulas.
export { counted, pieces, placed, proposals } from "./text.js";
