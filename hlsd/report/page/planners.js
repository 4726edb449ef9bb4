/* Which planners are shown: the legend in the bar, for all plots and tables. */

const hiddenPlanners = new Set();
const plannerListeners = [];

const isShown = (k) => !hiddenPlanners.has(k);

/* Be told when planners are shown or hidden. */
function onPlanners(listener) {
  plannerListeners.push(listener);
}

function startLegend() {
  const buttons = report.order.map((k) => {
    const button = element(
      "button",
      { type: "button", "aria-pressed": "true" },
      swatch(k),
      report.planners[k].name,
    );
    button.addEventListener("click", () => {
      if (!hiddenPlanners.delete(k)) hiddenPlanners.add(k);
      button.setAttribute("aria-pressed", String(isShown(k)));
      for (const listener of plannerListeners) listener();
    });
    return button;
  });
  byId("legend").replaceChildren(...buttons);
}
