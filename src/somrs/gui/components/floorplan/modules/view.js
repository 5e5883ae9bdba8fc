// The visible part of the map and its scale: conversion between metres and pixels.

const LEAST = 0.5; // pixels per metre
const MOST = 2500;
const MARGIN = 20; // pixels around fitted content
const TOOLS = 40; // pixels on the right for the tools
const FOOT = 26; // pixels below for the scale bar

export class View {
  constructor() {
    this.scale = 50; // pixels per metre
    this.x = 0; // centre
    this.y = 0;
    this.width = 1;
    this.height = 1;
    this.fitted = true; // not moved or zoomed by the user: fit again when the window is resized
  }

  size(width, height) {
    this.width = Math.max(width, 1);
    this.height = Math.max(height, 1);
  }

  toScreen(x, y) {
    return { x: this.width / 2 + (x - this.x) * this.scale, y: this.height / 2 - (y - this.y) * this.scale };
  }

  toMap(x, y) {
    return { x: this.x + (x - this.width / 2) / this.scale, y: this.y - (y - this.height / 2) / this.scale };
  }

  // The transformation of content in metres, on a sheet that exceeds the view by `over` of its size on each side.
  transform(over = 0) {
    const [left, top] = [(0.5 + over) * this.width, (0.5 + over) * this.height];
    return `translate(${left - this.x * this.scale} ${top + this.y * this.scale}) scale(${this.scale} ${-this.scale})`;
  }

  pan(dx, dy) {
    this.fitted = false;
    this.x -= dx / this.scale;
    this.y += dy / this.scale;
  }

  // Zoom around a point of the screen.
  zoom(factor, x = this.width / 2, y = this.height / 2) {
    this.fitted = false;
    const before = this.toMap(x, y);
    this.scale = Math.min(MOST, Math.max(LEAST, this.scale * factor));
    const after = this.toMap(x, y);
    this.x += before.x - after.x;
    this.y += before.y - after.y;
  }

  fit(box) {
    this.fitted = true;
    if (!box) return;
    const [w, h] = [Math.max(box.right - box.left, 0.5), Math.max(box.top - box.bottom, 0.5)];
    const [width, height] = [Math.max(this.width - 2 * MARGIN - TOOLS, 40), Math.max(this.height - 2 * MARGIN - FOOT, 40)];
    this.scale = Math.min(MOST, Math.max(LEAST, Math.min(width / w, height / h)));
    this.x = (box.left + box.right) / 2 + TOOLS / 2 / this.scale;
    this.y = (box.bottom + box.top) / 2 - FOOT / 2 / this.scale;
  }

  // Scroll a point into view, away from the edges. Returns whether the view moved.
  reveal(x, y, edge = 24) {
    const at = this.toScreen(x, y);
    const inside = at.x > edge && at.y > edge && at.x < this.width - edge && at.y < this.height - edge;
    if (!inside) [this.x, this.y, this.fitted] = [x, y, false];
    return !inside;
  }

  box() {
    const [a, b] = [this.toMap(0, this.height), this.toMap(this.width, 0)];
    return { left: a.x, bottom: a.y, right: b.x, top: b.y };
  }

  // A round length of 60 to 150 pixels for the scale bar.
  bar() {
    for (const power of [0.01, 0.1, 1, 10, 100, 1000])
      for (const step of [1, 2, 5]) {
        const metres = step * power;
        if (metres * this.scale >= 60) return { metres, pixels: metres * this.scale, text: lengthText(metres) };
      }
    return { metres: 1, pixels: this.scale, text: "1 m" };
  }
}

export function lengthText(metres) {
  if (metres < 1) return `${+(metres * 100).toFixed(0)} cm`;
  return metres < 1000 ? `${+metres.toFixed(2)} m` : `${+(metres / 1000).toFixed(2)} km`;
}
