// Links: the rings of their classes, access points, and the names of those who serve users.

/** The name of a drone or, from number run.drones on, of an access point. */
export function senderName(run, s) {
  return s < run.drones ? `drone ${s}` : `access point ${s - run.drones}`;
}

/** What all drones of the type of drone d have in common. */
export function typeOf(run, d) {
  return run.types[run.type_of[d]];
}

/** The radii of the classes of drone d at an altitude, the widest first; a disc has one. */
export function ringsAt(run, d, z) {
  const { rings, footprint_m: footprint } = typeOf(run, d);
  if (!rings) return [footprint];
  const { levels_m: levels, radii_m: radii } = rings;
  let k = 0;
  while (k + 2 < levels.length && levels[k + 1] <= z) k += 1;
  if (k + 1 >= levels.length) return radii[k];
  const share = Math.min(1, Math.max(0, (z - levels[k]) / (levels[k + 1] - levels[k])));
  return radii[k].map((radius, c) => radius + share * (radii[k + 1][c] - radius));
}

/** The thresholds and efficiencies of the classes of a sender's links, or null for a disc. */
export function ladderOf(run, s) {
  if (s < 0) return null;
  return s < run.drones ? typeOf(run, s).rings : run.points[s - run.drones];
}

/** A link in words: its class, its efficiency, and between which ratios it is. */
export function linkWords(run, s, c) {
  const ladder = ladderOf(run, s);
  if (!ladder || c < 1) return null;
  const { snr_db: snr, bit_s_hz: bits } = ladder;
  const ratio = run.interference ? "SINR" : "SNR";
  const range = c < snr.length ? `${snr[c - 1]} to ${snr[c]} dB` : `${snr[c - 1]} dB or more`;
  return `class ${c} of ${snr.length}: ${bits[c - 1]} bit/s/Hz, ${ratio} ${range}`;
}

/** How good a link is: its class as a share of the best one. */
export function quality(run, s, c) {
  const ladder = ladderOf(run, s);
  return ladder ? c / ladder.snr_db.length : 1;
}
