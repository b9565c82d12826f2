// The history of a request or a user up to an instant, from the user's events.

/** The history of a request so far: times in microseconds, null for what has not happened. */
export function requestSoFar(state, r) {
  const { episode, run, sums } = state;
  const { event, request } = episode;
  const u = request.user[r];
  const found = {
    request: r, user: u, service: run.services[request.service[r]],
    askedUs: request.tUs[r], requiredUs: request.requiredUs[r], mbit: request.mbit[r],
    bandwidthBps: request.bandwidthBps[r], servedUs: 0, firstUs: null, endUs: null,
    outcome: null, drones: [], by: -1, sinceUs: 0, deadlineUs: request.deadlineUs[r] ?? -1,
  };
  for (const i of episode.eventsOfUser(u)) {
    if (i >= sums.next) break;
    if (event.request[i] !== r) continue;
    const kind = run.kinds[event.kind[i]];
    if (kind === "serve") {
      found.by = event.drone[i];
      found.sinceUs = event.tUs[i];
    } else if (kind === "stop") {
      spell(found, event.tUs[i]);
      found.by = -1;
    } else if (CLOSES.has(kind)) {
      found.endUs = event.tUs[i];
      found.outcome = kind === "complete" ? "completed"
        : kind === "refuse" ? "refused" : kind === "late" ? "late" : kind === "drop" ? "dropped" : found.servedUs > 0 ? "unfinished" : "never served";
    }
  }
  if (found.by >= 0) spell(found, state.tUs);
  found.asked = request.tUs[r] <= state.tUs;
  return found;
}

const CLOSES = new Set(["complete", "refuse", "close", "late", "drop"]);

/** A service of 0 µs does not count. */
function spell(found, untilUs) {
  if (untilUs <= found.sinceUs) return;
  found.servedUs += untilUs - found.sinceUs;
  found.firstUs ??= found.sinceUs;
  if (found.drones.at(-1) !== found.by) found.drones.push(found.by);
}

/** The drones and access points whose footprints contain a user. */
export function covering(state, u) {
  const found = new Set();
  const { event } = state.episode;
  for (const i of state.episode.eventsOfUser(u)) {
    if (i >= state.sums.next) break;
    const kind = state.run.kinds[event.kind[i]];
    if (kind === "enter") found.add(event.drone[i]);
    if (kind === "exit") found.delete(event.drone[i]);
  }
  return [...found].sort((a, b) => a - b);
}
