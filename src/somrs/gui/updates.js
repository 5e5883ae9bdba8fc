// At each update, NiceGUI draws all elements of the page, and it has made every part of each of them reactive: reading them takes a third to
// a half of the time. An update replaces an element as a whole, so its parts need not be reactive, unless it has a value, which the browser
// changes by itself, too.

const { replaceUndefinedAttributes } = window;

window.replaceUndefinedAttributes = (element) => {
  replaceUndefinedAttributes(element);
  if (!("value" in element.props || "model-value" in element.props)) window.Vue.markRaw(element);
};
