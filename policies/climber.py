"""An example of a policy of one's own: climb the hill of attached users.

    desim-uav run case8 --policy policies.climber:Climber

A drone goes on in its direction while it gains users, turns clockwise when it loses some, wanders
where it has none, hovers where it has more than its share, and goes home to charge in time.
"""

from desim_uav.model.rules import Action

CLOCKWISE = (Action.FORWARD, Action.RIGHT, Action.BACKWARD, Action.LEFT)


class Climber:
    """Knows only what it observes: no map, no users' positions, no other drone."""

    ceiling = True

    def begin(self, world, streams, carried=False):
        """Remember each drone's heading and how many users it had."""
        drones = world.scenario.drone_count
        self.index = {action: k for k, action in enumerate(world.actions)}
        self.share = len(world.homes) / drones
        self.chance = [streams.generator(drone) for drone in range(drones)]
        if not carried:
            self.heading = [drone % len(CLOCKWISE) for drone in range(drones)]
            self.had = [0] * drones

    def act(self, observation, mask):
        """One command for one drone: an index into the scenario's actions."""
        if sum(mask) == 1:  # charging, or on the way home
            return list(mask).index(True)
        home = self.index.get(Action.GOTO_CHARGING_STATION)
        if home is not None and mask[home] and observation.battery_s < observation.return_s + 120:
            return home
        drone, users = observation.drone, observation.attached_users
        gained, self.had[drone] = users > self.had[drone], users
        if users >= self.share:
            return self.index[Action.HOVER]
        if users == 0:
            self.heading[drone] = int(self.chance[drone].integers(len(CLOCKWISE)))
        elif not gained:
            self.heading[drone] = (self.heading[drone] + 1) % len(CLOCKWISE)
        return self.index[CLOCKWISE[self.heading[drone]]]
