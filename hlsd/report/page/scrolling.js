/* What is wider than its place says so: a line above it, and a shade at its edges. */

function startScrolling() {
  for (const host of document.querySelectorAll(".scroll")) {
    const cue = element("p", { class: "cue", "aria-hidden": "true", hidden: "" });
    host.before(cue);
    const show = () => {
      const hidden = host.scrollWidth - host.clientWidth;
      const left = host.scrollLeft > 4;
      const right = host.scrollLeft < hidden - 4;
      host.classList.toggle("more-left", hidden > 4 && left);
      host.classList.toggle("more-right", hidden > 4 && right);
      cue.hidden = hidden <= 4;
      const ways = [left ? "← to the left" : "", right ? "to the right →" : ""];
      cue.textContent = `More columns ${ways.filter(Boolean).join(" and ")}`;
    };
    host.addEventListener("scroll", show, { passive: true });
    const watcher = new ResizeObserver(show);
    watcher.observe(host);
    watcher.observe(host.firstElementChild);
  }
}
