/* Light or dark: as the system has it, until someone chooses. */

const redraws = [];

/* Have something drawn again when colours or sizes change, as canvases need. */
function onRedraw(draw) {
  redraws.push(draw);
}

function redrawAll() {
  resolved.clear();
  for (const draw of redraws) draw();
}

/* A CSS colour, such as var(--ink), as canvases want it. */
const resolved = new Map();
const probe = document.body.appendChild(element("span", { hidden: "" }));
function resolve(colour) {
  if (!resolved.has(colour)) {
    probe.style.color = colour;
    resolved.set(colour, getComputedStyle(probe).color);
  }
  return resolved.get(colour);
}

function startTheme() {
  const button = byId("theme");
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const chosen = () => document.documentElement.dataset.theme;
  const isDark = () => (chosen() ? chosen() === "dark" : dark.matches);
  const show = () => {
    button.textContent = isDark() ? "Light" : "Dark";
    button.setAttribute(
      "aria-label",
      `Switch to ${isDark() ? "light" : "dark"} colours`,
    );
    redrawAll();
  };
  button.addEventListener("click", () => {
    document.documentElement.dataset.theme = isDark() ? "light" : "dark";
    show();
  });
  dark.addEventListener("change", show);
  let width = innerWidth;
  addEventListener("resize", () => {
    if (innerWidth === width) return;
    width = innerWidth;
    requestAnimationFrame(redrawAll);
  });
  show();
}
