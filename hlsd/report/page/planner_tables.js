/* Tables with a row per planner sort by any head; the first gives the page's order. */

function startPlannerTables() {
  for (const shown of document.querySelectorAll("table.sorts")) {
    const body = shown.tBodies[0];
    const first = [...body.rows];
    [...shown.tHead.rows[0].cells].forEach((head, k) => {
      if (head.dataset.metric === report.headline) head.ariaSort = sortOf(head, true);
      const button = head.querySelector("button");
      button.addEventListener("click", () => {
        const best = head.ariaSort !== sortOf(head, true);
        for (const other of shown.tHead.rows[0].cells)
          other.removeAttribute("aria-sort");
        if (k > 0) head.ariaSort = sortOf(head, best);
        body.append(...(k === 0 ? first : inOrder(first, k, head.ariaSort)));
      });
    });
  }
}

/* The best comes first, where one way is better; else the greatest. */
function sortOf(head, best) {
  const lower = report.metrics[head.dataset.metric]?.better === "lower";
  return lower === best ? "ascending" : "descending";
}

/* Unknown values come last, whichever way. */
function inOrder(rows, k, order) {
  const value = (row) => Number(row.cells[k].dataset.value ?? NaN);
  const way = order === "ascending" ? 1 : -1;
  return [...rows].sort((a, b) => {
    const [left, right] = [value(a), value(b)];
    if (Number.isNaN(left) || Number.isNaN(right))
      return Number.isNaN(left) - Number.isNaN(right);
    return way * (left - right);
  });
}
