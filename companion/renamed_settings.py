"""Settings that had another name before: dotted old name -> dotted new name.

An entry of a table stands for all of its keys that have no entry of their own. An old name in a file or in `--set` is
an error that gives the new one; in the settings of a log it is read as the new one.
"""

RENAMED_SETTINGS = {
    "avoidance.decisiveness": "avoidance.switch_margin",
    "avoidance.grain": "avoidance.merge_distance",
    "avoidance.heights": "avoidance.altitude_search",
    "avoidance.heights.above": "avoidance.altitude_search.max_climb",
    "avoidance.heights.below": "avoidance.altitude_search.max_descent",
    "avoidance.heights.lowest": "avoidance.altitude_search.min_height",
    "avoidance.heights.price": "avoidance.altitude_search.height_cost",
    "avoidance.heights.patience": "avoidance.altitude_search.dwell_time",
    "avoidance.plan.tight": "avoidance.plan.tight_inflation",
    "avoidance.plan.detour": "avoidance.plan.max_detour",
    "avoidance.plan.doubt": "avoidance.plan.unconfirmed_cost",
    "avoidance.plan.squeeze": "avoidance.plan.tight_cost",
    "avoidance.plan.habit": "avoidance.plan.switch_cost",
    "avoidance.plan.comfort": "avoidance.plan.proximity_radius",
    "avoidance.plan.closeness": "avoidance.plan.proximity_cost",
    "avoidance.plan.unknown": "avoidance.plan.unknown_cost",
    "avoidance.tracks.gap": "avoidance.tracks.range_gap",
    "avoidance.tracks.widest": "avoidance.tracks.max_extent",
    "avoidance.tracks.acceleration": "avoidance.tracks.acceleration_noise",
    "avoidance.tracks.hits": "avoidance.tracks.confirm_hits",
    "avoidance.tracks.misses": "avoidance.tracks.delete_misses",
    "avoidance.tracks.slowest": "avoidance.tracks.min_speed",
    "avoidance.tracks.certainty": "avoidance.tracks.min_speed_sigmas",
    "avoidance.tracks.steady": "avoidance.tracks.moving_scans",
    "avoidance.tracks.rest": "avoidance.tracks.stopped_scans",
    "avoidance.vfh.radius": "avoidance.vfh.enlargement_radius",
    "avoidance.vfh.low": "avoidance.vfh.low_threshold",
    "avoidance.vfh.high": "avoidance.vfh.high_threshold",
    "avoidance.course.follow": "avoidance.course.velocity_gain",
    "avoidance.course.leash": "avoidance.course.max_lead",
    "avoidance.course.give_in": "avoidance.course.yield_threshold",
    "avoidance.guard.crawl": "avoidance.guard.tight_speed",
    "avoidance.guard.delay": "avoidance.guard.reaction_time",
    "avoidance.guard.steepness": "avoidance.guard.barrier_gain",
    "avoidance.guard.nearness": "avoidance.guard.closing_gain",
    "avoidance.guard.reach": "avoidance.guard.obstacle_range",
}
