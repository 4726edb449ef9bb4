/* A long list, a page of it at a time: tens of thousands of rows are more than a browser
   lays out at once. Buttons lead to the other pages; a list of one page has none. */

function paged(id, size, show) {
  let all = [];
  let first = 0;
  const turn = (to) => {
    const last = Math.max(0, Math.ceil(all.length / size) - 1) * size;
    first = Math.min(Math.max(to, 0), last);
    show(all.slice(first, first + size));
    where.textContent = `${first + 1} to ${Math.min(first + size, all.length)} of ${all.length}`;
    byId(id).hidden = all.length <= size;
    back.disabled = start.disabled = first === 0;
    on.disabled = end.disabled = first === last;
  };
  const button = (text, to) => {
    const made = element("button", { type: "button" }, text);
    made.addEventListener("click", () => turn(to()));
    return made;
  };
  const where = element("output", { "aria-live": "polite" });
  const start = button("First", () => 0);
  const back = button("Previous", () => first - size);
  const on = button("Next", () => first + size);
  const end = button("Last", () => all.length);
  byId(id).replaceChildren(start, back, where, on, end);
  return (list) => {
    all = list;
    turn(0);
  };
}
