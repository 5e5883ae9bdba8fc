import assert from "node:assert/strict";
import test from "node:test";
import { counted, pieces, placed, proposals } from "somrs-formula/text.js";

const kinds = (text) => pieces(text, [], null).filter((piece) => piece.kind).map((piece) => [piece.text, piece.kind]);

test("words are coloured by what they are", () => {
  assert.deepEqual(kinds('Jar isOn ?Place AND Jar.Label = "a \\" AND" OR x = 2.5 # AND'), [
    ["?Place", "variable"], ["AND", "keyword"], ['"a \\" AND"', "text"], ["OR", "keyword"], ["2.5", "number"], ["# AND", "comment"],
  ]);
  assert.deepEqual(kinds("FORALL ?x (EXISTS"), [["FORALL", "keyword"], ["?x", "variable"], ["EXISTS", "keyword"]]);
  assert.deepEqual(kinds("ANDREW Jar2 TRUE"), [["TRUE", "number"]], "a part of a name is no keyword");
  assert.deepEqual(kinds('"open'), [['"open', "text"]]);
});

test("the pieces together are the text", () => {
  const text = 'Żaba isOn ?A AND "x" # z';
  assert.equal(pieces(text, [{ from: 2, to: 7 }], 3).map((piece) => piece.text).join(""), text);
});

test("what is wrong is underlined, and nothing else", () => {
  const underlined = (text, wrong) => pieces(text, wrong, null).filter((piece) => piece.wrong).map((piece) => piece.text);
  assert.deepEqual(underlined("Jar isAt Table", [{ from: 4, to: 8 }]), ["isAt"]);
  assert.deepEqual(underlined("Jar isOn", [{ from: 8, to: 8 }]), [""], "what is missing at the end, behind it");
  assert.ok(pieces("Jar", [{ from: 3, to: 9 }], null).at(-1).end);
});

test("a completion begins at its mark", () => {
  const marked = (mark) => pieces("Jar isOn Ta", [], mark).filter((piece) => piece.mark).map((piece) => piece.text);
  assert.deepEqual([marked(9), marked(11), marked(null)], [["Ta"], [""], []]);
});

test("places are counted in whole characters, as the server does", () => {
  const text = "🤖 isOn 🪑";
  assert.equal(counted(text, text.length), 8);
  assert.equal(placed(text, 2), 3);
  for (let count = 0; count <= 8; count++) assert.equal(counted(text, placed(text, count)), count);
});

test("proposals are read from what the server hints", () => {
  assert.deepEqual(proposals("did you mean Jar002 or Jar003?"), ["Jar002", "Jar003"]);
  assert.deepEqual([proposals("a relation is expected"), proposals("")], [[], []]);
});
