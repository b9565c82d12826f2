// One episode as it was logged: requests, events and positions. Nothing here changes.

export const US = 1e6;

export class Episode {
  constructor(run, index, columns) {
    this.run = run;
    this.index = index;
    this.about = run.episodes[index];
    this.durationUs = this.about.duration_us;
    this.request = {
      count: columns["request.user"].length,
      user: Int32Array.from(columns["request.user"]),
      service: columns["request.service"],
      tUs: columns["request.t_us"],
      requiredUs: columns["request.required_us"],
      mbit: columns["request.mbit"],
      bandwidthBps: columns["request.bandwidth_bps"],
      deadlineUs: columns["request.deadline_us"] ?? [], // -1 without one
    };
    this.event = {
      count: columns["event.t_us"].length,
      tUs: columns["event.t_us"],
      phase: columns["event.phase"],
      kind: columns["event.kind"],
      drone: Int32Array.from(columns["event.drone"]),
      user: Int32Array.from(columns["event.user"]),
      request: Int32Array.from(columns["event.request"]),
      station: Int32Array.from(columns["event.station"]),
      linkClass: Int32Array.from(columns["event.link_class"]),
      other: Int32Array.from(columns["event.other"]), // the second drone of an event of two
      stage: Int32Array.from(columns["event.stage"] ?? []), // the stage that a request begins
      update: Int32Array.from(columns["event.update"] ?? []), // of a sensor
    };
    this.takenUs = columns["update.t_us"] ?? []; // when each update of a sensor was taken
    this.leg = legsOf(columns);
    this.walk = {
      first: offsets(columns["walk.count"]),
      tUs: columns["walk.t_us"],
      x: Float32Array.from(columns["walk.x"]),
      y: Float32Array.from(columns["walk.y"]),
      z: Float32Array.from(columns["walk.z"]),
    };
    this.step = {
      count: columns["step.t_us"].length,
      tUs: columns["step.t_us"], // their ends
      reward: columns["step.reward"],
      told: columns["step.told"],
      taken: columns["step.taken"],
    };
    this.battery = run.types.every((type) => type.capacity_us === null) ? null : {
      first: offsets(columns["battery.count"]),
      tUs: columns["battery.t_us"],
      us: columns["battery.us"],
    };
    this.rewardSoFar = this.#rewards();
    this.near = new Int32Array(run.users).fill(-1); // the way point each user was at last
  }

  /** The mean over drones of the sum of rewards, by the number of steps that have ended. */
  #rewards() {
    const { drones } = this.run;
    const sums = new Float64Array(this.step.count + 1);
    for (let k = 0; k < this.step.count; k += 1) {
      let sum = 0;
      for (let d = 0; d < drones; d += 1) sum += this.step.reward[k * drones + d];
      sums[k + 1] = sums[k] + sum / drones;
    }
    return sums;
  }

  // ---- steps

  /** The number of steps that have ended at a time: that of the present one, counted from 0. */
  stepsEnded(tUs) {
    const { tUs: ends, count } = this.step;
    return count > 0 && ends[0] <= tUs ? lastUpTo(ends, 0, count, tUs) + 1 : 0;
  }

  // ---- drones

  /** The number of the present or latest leg of drone d at a time. */
  legAt(d, tUs) {
    return lastUpTo(this.leg.tUs, this.leg.first[d], this.leg.first[d + 1], tUs);
  }

  /** Write the exact position of drone d into `place`, x, y, z in metres, by the closed form of its leg. */
  dronePlace(d, tUs, place) {
    const { leg } = this;
    const k = this.legAt(d, tUs);
    const share = this.shareOfLeg(k, tUs);
    place[0] = leg.xFrom[k] + share * (leg.xTo[k] - leg.xFrom[k]);
    place[1] = leg.yFrom[k] + share * (leg.yTo[k] - leg.yFrom[k]);
    place[2] = leg.zFrom[k] + share * (leg.zTo[k] - leg.zFrom[k]);
    return place;
  }

  /** The share of a leg that has been flown, 0 … 1. */
  shareOfLeg(k, tUs) {
    const elapsedUs = tUs - this.leg.tUs[k];
    if (elapsedUs >= this.leg.durationUs[k]) return 1;
    return travelled(this.run.profiles[this.leg.profile[k]], elapsedUs / US);
  }

  /** The charge of drone d's battery, in microseconds of autonomy; null if it is unlimited. */
  batteryUs(d, tUs) {
    const { battery } = this;
    if (battery === null || battery.first[d] === battery.first[d + 1]) return null;
    const end = battery.first[d + 1];
    const k = lastUpTo(battery.tUs, battery.first[d], end, tUs);
    if (k + 1 >= end) return battery.us[k];
    const span = battery.tUs[k + 1] - battery.tUs[k];
    const share = span > 0 ? (tUs - battery.tUs[k]) / span : 1;
    return battery.us[k] + share * (battery.us[k + 1] - battery.us[k]);
  }

  /** The power that drone d takes in the air, in watts; null if its battery has no energy. */
  powerW(d, tUs) {
    const hoverW = this.run.types[this.run.type_of[d]].hover_w;
    if (hoverW === null) return null;
    const k = this.legAt(d, tUs);
    const elapsedUs = tUs - this.leg.tUs[k];
    if (elapsedUs >= this.leg.durationUs[k]) return hoverW;
    return interpolated(this.run.powers[this.leg.profile[k]], elapsedUs / US);
  }

  // ---- users

  /** Write the positions of all users into two arrays, x and y in metres. */
  userPlaces(tUs, x, y) {
    const { walk, near } = this;
    for (let u = 0; u < near.length; u += 1) {
      const first = walk.first[u];
      const last = walk.first[u + 1] - 1;
      let k = near[u] < 0 ? first : near[u];
      while (k < last && walk.tUs[k + 1] <= tUs) k += 1;
      while (k > first && walk.tUs[k] > tUs) k -= 1;
      near[u] = k;
      const span = k < last ? walk.tUs[k + 1] - walk.tUs[k] : 0;
      const share = span > 0 ? Math.max(0, (tUs - walk.tUs[k]) / span) : 0;
      const next = share > 0 ? k + 1 : k;
      x[u] = walk.x[k] + share * (walk.x[next] - walk.x[k]);
      y[u] = walk.y[k] + share * (walk.y[next] - walk.y[k]);
    }
  }

  // ---- events by the user or drone they concern, computed on first use

  /** The numbers of a user's events, in order. */
  eventsOfUser(u) {
    this.byUser ??= grouped(this.event.user, this.run.users);
    return this.byUser(u);
  }

  /** The numbers of a drone's own events (without a user), in order. */
  eventsOfDrone(d) {
    this.byDrone ??= grouped(
      this.event.drone.map((drone, i) => (this.event.user[i] < 0 ? drone : -1)),
      this.run.drones,
    );
    return this.byDrone(d);
  }

  /** The numbers of the events at which a drone was asked, in order. */
  decisionsOf(d) {
    const decide = this.run.kinds.indexOf("decide");
    this.asked ??= Array.from({ length: this.run.drones }, (_, drone) => (
      this.eventsOfDrone(drone).filter((i) => this.event.kind[i] === decide)));
    return this.asked[d];
  }

  /** The numbers of a user's requests, in order. */
  requestsOfUser(u) {
    this.requestsBy ??= grouped(this.request.user, this.run.users);
    return this.requestsBy(u);
  }
}

function legsOf(columns) {
  const of = (name) => columns[`leg.${name}`];
  return {
    first: of("first"),
    tUs: of("t_us"),
    durationUs: of("duration_us"),
    mode: of("mode"),
    profile: of("profile"),
    xFrom: of("x_from"), yFrom: of("y_from"), zFrom: of("z_from"),
    xTo: of("x_to"), yTo: of("y_to"), zTo: of("z_to"),
  };
}

function offsets(counts) {
  const first = new Int32Array(counts.length + 1);
  for (let i = 0; i < counts.length; i += 1) first[i + 1] = first[i] + counts[i];
  return first;
}

/** The last index in times[begin … end) that is not after t, or `begin` if all are. */
export function lastUpTo(times, begin, end, t) {
  let low = begin;
  let high = end;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] <= t) low = middle + 1;
    else high = middle;
  }
  return Math.max(begin, low - 1);
}

/** The share of a transit's distance that is flown `elapsedS` after its start. */
function travelled(profile, elapsedS) {
  let phase = 0;
  while (phase + 1 < profile.length && profile[phase + 1][0] <= elapsedS) phase += 1;
  const [start, share, speed, acceleration] = profile[phase];
  const t = elapsedS - start;
  return share + speed * t + 0.5 * acceleration * t * t;
}

/** The value at t of a curve of points [t, value] that is straight between them. */
function interpolated(points, t) {
  let k = 0;
  while (k + 2 < points.length && points[k + 1][0] <= t) k += 1;
  const [[from, before], [to, after]] = [points[k], points[k + 1]];
  return before + ((t - from) / (to - from)) * (after - before);
}

function grouped(keys, count) {
  const first = new Int32Array(count + 1);
  for (const key of keys) if (key >= 0) first[key + 1] += 1;
  for (let k = 0; k < count; k += 1) first[k + 1] += first[k];
  const next = first.slice();
  const order = new Int32Array(first[count]);
  for (let i = 0; i < keys.length; i += 1) if (keys[i] >= 0) order[next[keys[i]]++] = i;
  return (key) => order.subarray(first[key], first[key + 1]);
}
