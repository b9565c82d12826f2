// Two branches of a run, which have everything in common until they part.

/** The time until which two branches are the same: Infinity for the whole episode, null if none. */
export function forkUs(states) {
  const forks = states.map(({ run }) => run.fork);
  const [one, other] = forks;
  if (forks.length < 2 || !one || !other) return null;
  if (one.episode !== other.episode || one.t_us !== other.t_us) return null;
  const { episode } = states[0].episode.about;
  if (episode > one.episode) return null;
  return episode < one.episode ? Infinity : one.t_us;
}

/** Whether two branches are still the same at a time. */
export function isCommon(states, tUs) {
  const parts = forkUs(states);
  return parts !== null && tUs < parts;
}
