/* A second run beside the first, in the same world and on the same clock. */

function startBeside() {
  byId("replay-beside").addEventListener("change", () => {
    const id = byId("replay-beside").value;
    const beside = id === "" ? null : runs[Number(id)];
    load([replay.run], { time_s: replay.time_s, beside });
  });
}

/* What is beside the shown run now, for another: the same planner's, where there is one,
   of the same trial if it has that. */
function besideIn(run) {
  const { run: held } = replay.beside;
  if (!run || !held) return null;
  const own = runsOfWorld[run.world].filter(
    (other) => other.planner === held.planner && other.recorded && other !== run,
  );
  return own.find(({ trial }) => trial === run.trial) ?? own[0] ?? null;
}

/* All other runs of the world that can be replayed. */
function offerBeside(run, beside) {
  const others = run?.recorded
    ? runsOfWorld[run.world].filter((other) => other.recorded && other !== run)
    : [];
  const text = ({ planner, trial }) =>
    `${report.planners[planner].name}, trial ${trial}`;
  const select = byId("replay-beside");
  options(select, [["", "nobody"], ...others.map((other) => [other.id, text(other)])]);
  select.value = beside ? String(beside.id) : "";
  select.disabled = !others.length;
}
