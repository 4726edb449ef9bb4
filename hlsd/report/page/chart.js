/* A small chart in SVG, drawn to the width it has, so that text stays readable. */

let charts = 0;
const SVG = "http://www.w3.org/2000/svg";

function svgElement(name, attributes, text) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text !== undefined) made.textContent = text;
  return made;
}

/* Round numbers from low to high, about `count` of them, `least` apart or more. */
function ticks(low, high, count, least = 0) {
  const span = high - low || 1;
  const rough = Math.max(span / Math.max(count, 1), least);
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((k) => k * power).find((size) => size >= rough);
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * span; k += 1) {
    found.push(Number((k * step).toPrecision(12)));
  }
  return found;
}

/*
 * Draw axes and layers into `host`.
 *
 * spec.label      what the chart shows, for those who do not see it
 * spec.height     in pixels
 * spec.x, spec.y  {domain: [low, high], title, ticks: count, least: distance of ticks,
 *                 format: number -> text}
 * spec.limit      a dashed line at this y
 * spec.layers     functions of (svg, X, Y), X and Y from numbers to pixels
 * spec.compact    for small multiples: fewer ticks, no title of y
 */
function drawChart(host, spec) {
  const width = Math.max(host.clientWidth, 140);
  const { height, compact } = spec;
  const edge = compact
    ? { left: 42, right: 10, top: 8, bottom: 36 }
    : { left: 62, right: 12, top: 10, bottom: 44 };
  const [right, bottom] = [width - edge.right, height - edge.bottom];
  const scale =
    ([low, high], from, to) =>
    (value) =>
      from + ((value - low) / (high - low || 1)) * (to - from);
  const X = scale(spec.x.domain, edge.left, right);
  const Y = scale(spec.y.domain, bottom, edge.top);
  const svg = svgElement("svg", {
    viewBox: `0 0 ${width} ${height}`,
    height,
    role: "img",
    "aria-label": spec.label,
  });
  const write = (text, attributes) => svg.append(svgElement("text", attributes, text));
  for (const value of ticks(...spec.y.domain, spec.y.ticks ?? 6)) {
    const y = Y(value);
    svg.append(
      svgElement("line", { class: "grid", x1: edge.left, x2: right, y1: y, y2: y }),
    );
    write((spec.y.format ?? String)(value), {
      x: edge.left - 6,
      y: y + 4,
      "text-anchor": "end",
    });
  }
  const room = Math.floor((right - edge.left) / 55);
  const count = Math.min(spec.x.ticks ?? 10, room);
  for (const value of ticks(...spec.x.domain, count, spec.x.least)) {
    const x = X(value);
    svg.append(
      svgElement("line", { class: "axis", x1: x, x2: x, y1: bottom, y2: bottom + 4 }),
    );
    write((spec.x.format ?? String)(value), {
      x,
      y: bottom + 17,
      "text-anchor": "middle",
    });
  }
  svg.append(
    svgElement("path", { class: "axis", d: `M${edge.left} ${bottom}H${right}` }),
  );
  write(spec.x.title, {
    x: (edge.left + right) / 2,
    y: height - 5,
    "text-anchor": "middle",
  });
  if (spec.y.title && !compact) {
    const y = (edge.top + bottom) / 2;
    write(spec.y.title, {
      x: 12,
      y,
      "text-anchor": "middle",
      transform: `rotate(-90 12 ${y})`,
    });
  }
  if (spec.limit !== undefined) {
    const y = Y(spec.limit);
    svg.append(
      svgElement("line", { class: "limit", x1: edge.left, x2: right, y1: y, y2: y }),
    );
  }
  // Curves end at the axes; dots on an axis stay whole.
  const id = `clip-${(charts += 1)}`;
  const box = {
    x: edge.left,
    y: edge.top - 6,
    width: right - edge.left,
    height: bottom - edge.top + 6,
  };
  const clip = svgElement("clipPath", { id });
  clip.append(svgElement("rect", box));
  const inside = svgElement("g", { "clip-path": `url(#${id})` });
  const upon = svgElement("g", {});
  svg.append(clip, inside, upon);
  for (const layer of spec.layers) layer(layer.unclipped ? upon : inside, X, Y);
  host.replaceChildren(svg);
  return { svg, X, Y, left: edge.left, right, top: edge.top, bottom };
}

/* Layers: each gives a function for `spec.layers`. */

const coloured = (colour, made) => {
  made.style.setProperty("--colour", colour);
  return made;
};

const points = (xs, ys, X, Y) =>
  xs.map((x, k) => `${X(x).toFixed(1)} ${Y(ys[k]).toFixed(1)}`);

function curve(colour, xs, ys) {
  return (svg, X, Y) => {
    if (!xs.length) return;
    const d = `M${points(xs, ys, X, Y).join("L")}`;
    svg.append(coloured(colour, svgElement("path", { class: "curve", d })));
  };
}

function band(colour, xs, lows, highs) {
  return (svg, X, Y) => {
    if (!xs.length || lows.includes(null)) return; // no interval, no band
    const back = points(xs, lows, X, Y).reverse();
    const d = `M${[...points(xs, highs, X, Y), ...back].join("L")}Z`;
    svg.append(coloured(colour, svgElement("path", { class: "band", d })));
  };
}

/* Of many dots an element each would take seconds: they are one, of points with round
   ends. */
const MANY_DOTS = 1500;

function dots(colour, xs, ys, radius) {
  const layer = (svg, X, Y) => {
    if (xs.length > MANY_DOTS) {
      const d = points(xs, ys, X, Y)
        .map((point) => `M${point}h0`)
        .join("");
      const all = svgElement("path", { class: "dots", d, "stroke-width": 2 * radius });
      svg.append(coloured(colour, all));
      return;
    }
    for (const [k, x] of xs.entries()) {
      const at = { cx: X(x).toFixed(1), cy: Y(ys[k]).toFixed(1), r: radius };
      svg.append(coloured(colour, svgElement("circle", { class: "dot", ...at })));
    }
  };
  layer.unclipped = true;
  return layer;
}

/* The area between two curves, of the colour of a class. */
function area(kind, xs, lows, highs) {
  return (svg, X, Y) => {
    const back = points(xs, lows, X, Y).reverse();
    const d = `M${[...points(xs, highs, X, Y), ...back].join("L")}Z`;
    svg.append(svgElement("path", { class: `area ${kind}`, d }));
  };
}

/*
 * Show a box of text that follows the pointer.
 *
 * `describe` gets pixels of the drawing and returns {x, y, text, mark, pick} or null:
 * mark(svg) draws what is pointed at, pick() is what a click does.
 */
function followPointer(host, drawn, describe) {
  const tip = element("div", { class: "tip", hidden: "" });
  host.append(tip);
  const marks = svgElement("g", {});
  drawn.svg.append(marks);
  let found = null;
  drawn.svg.addEventListener("pointermove", (event) => {
    const box = drawn.svg.getBoundingClientRect();
    found = describe(event.clientX - box.left, event.clientY - box.top);
    marks.replaceChildren();
    tip.hidden = !found;
    drawn.svg.style.cursor = found?.pick ? "pointer" : "";
    if (!found) return;
    found.mark?.(marks);
    tip.textContent = found.text;
    const room = box.width - tip.offsetWidth;
    const aside = found.x + 14 > room ? found.x - tip.offsetWidth - 14 : found.x + 14;
    tip.style.left = `${Math.max(0, aside)}px`;
    tip.style.top = `${Math.max(0, found.y - tip.offsetHeight - 8)}px`;
  });
  drawn.svg.addEventListener("pointerleave", () => {
    tip.hidden = true;
    marks.replaceChildren();
  });
  drawn.svg.addEventListener("click", () => found?.pick?.());
}
