"""docs/control.md: what the default controller adds to the paper's, and what that is worth."""

from studies.report import Page

CONTROL = Page(
    name="control",
    introduction="""# Past the paper: the default controller, measured

The paper's laws stay what they are (backstepping for position, an LQR for attitude). Around them the default controller
has: rates, angular acceleration and thrust of the reference from its jerk and snap by differential flatness with drag;
a prediction of the state over the age of the telemetry and the hold of the command; estimates of the thrust's scale,
the drag's scale and a disturbing acceleration; an adaptive (integral) term. Each is a setting (docs/settings.md).

Every figure of the studies comes from the command above it: `make control` runs all of them.

## With a real estimator

PX4's EKF2 in a hover wanders by 0.1-0.3 m/s: the acceleration that the model does not explain is 0.5 m/s2 over a
tenth of a second, 0.25 over one second and 0.1 over ten, so noise of the velocity is coloured, not white. In a hover
the thrust's scale and a vertical disturbance act alike, and what can't be told apart drifts together. The observer
therefore anchors the vertical disturbance (it falls back to 0 at `disturbance_fading`) and leaves the drag's scale
alone at low speed. The thrust's scale over its true value, with the observer replayed over recorded telemetry and
thrust (the true value by the mean thrust of the hover):

| flight | before | now | disturbance, down / m/s2 | drag's scale |
| --- | --- | --- | --- | --- |
| PX4, hover, 180 s | 1.09-1.52 | 0.98-1.02 | -1.1 to 0.9 | 0.99-1.00 |
| PX4, lemniscate, 4 m/s | 0.90-1.18 | 0.99-1.03 | -0.7 to 0.6 | 1.7-3.0 |
| ArduPilot, circle, 4 m/s | 1.05-1.13 | 1.00-1.01 | -0.1 to 0.2 | 1.1-1.2 |
| ArduPilot, among posts | 1.04-1.16 | 0.97-1.00 | -0.9 to 0.9 | 1.3-2.4 |

Rotors that climb give less thrust, and no vehicle file says by how much. In the climb that passes for weight: the
height was off by 12 mm in ArduCopter's hover after the take-off, and took five seconds to come back. The thrust's scale
is therefore in doubt again as a climb ends (`climb_uncertainty`), and learned anew: 4 to 7 mm there, whether 5, 10 or
20 % are doubted for each m/s. To estimate the damping itself was worse: at the lift-off, where that vehicle's thrust
lags more than is modelled, it went astray.

Such an estimator's velocity is not the rate of its position either: PX4's differ by 0.25 m/s (RMS, `px4_hover_180s`,
over windows of 0.25 to 4 s alike), ArduPilot's by 0.03. A controller that believes both flies beside its reference. The
difference is learned from the positions within `velocity_settling` (0.5 s) and added to the velocity
(`companion/velocity_match.py`), which took the tracking on PX4 from 0.22-0.30 m to 0.07-0.15 m
([px4.md](px4.md#what-happens-in-a-flight)), by the truth as well.

ArduPilot divides the thrust that it is asked for by the cosine of its tilt, with rates as well as with attitudes (angle
boost), which the thrust model undoes. `tests/companion/control/test_observer_noise.py` has the same with white,
coloured, vibrating and late velocities.

## Beside others on the same sensors

RotorPy's SE3 controller and ours, both on RotorPy's vehicle and on what our estimator makes of our sensors there
([vehicle-sim.md](vehicle-sim.md#sensors-and-the-estimator)), each with the same five seeds: RMSE in m of the place that
is told, mean of the seeds, and in brackets of the true one. `python bench/tracking.py --sensors gnss` and without it:

| track | RotorPy, truth | ours, truth | RotorPy, rtk | ours, rtk | RotorPy, gnss | ours, gnss |
| --- | --- | --- | --- | --- | --- | --- |
| circle, 2 m/s | 0.127 | 0.002 | 0.127 (0.128) | 0.016 (0.028) | 0.128 (0.164) | 0.040 (0.105) |
| lemniscate, 2 m/s | 0.083 | 0.001 | 0.086 (0.088) | 0.015 (0.027) | 0.090 (0.124) | 0.039 (0.101) |
| circle, 4 m/s | 0.193 | 0.008 | 0.194 (0.195) | 0.019 (0.031) | 0.202 (0.228) | 0.042 (0.105) |
| lemniscate, 4 m/s | 0.132 | 0.007 | 0.132 (0.132) | 0.018 (0.030) | 0.132 (0.168) | 0.039 (0.106) |
| circle, 8 m/s | 0.505 | 0.045 | 0.507 (0.509) | 0.048 (0.055) | 0.511 (0.527) | 0.062 (0.115) |
| lemniscate, 8 m/s | 0.349 | 0.030 | 0.347 (0.346) | 0.034 (0.043) | 0.346 (0.364) | 0.048 (0.112) |

Of that vehicle's drag ours knows what is right in a hover alone. PX4 and ArduCopter fly their own controllers on their
own estimators, EKF2 and EKF3, and ours beside them on the same vehicles: PX4's told error is 2.8 to 15 times ours
([px4.md](px4.md#what-happens-in-a-flight)), ArduCopter's 2.3 to 23 times
([ardupilot.md](ardupilot.md#what-happens-in-a-flight)).

## Disturbing torques

A centre of mass aside, or a weak rotor, turns a vehicle whose rate loop has no integral. It leans until its attitude's
error stops that, and flies beside the reference. `control/torque_observer.py` finds the angular acceleration that no
command explains, in proportion to the thrust, and it is made up for in the rates, the torque or the attitude that is
sent (`control.estimation.torque_bandwidth`), up to a third of the vehicle's full torque. About the yaw axis that is
done where torques are commanded alone, since flight controllers turn slowly there and integrate their errors. Circle
at 4 m/s, vehicle `paper_quad`, RMSE in mm on the track; in brackets without the observer, which is with a bandwidth of
0 (one flight each on the truth; `tests/flights/test_disturbing_torque.py` flies some of them):

| output | sound | centre of mass 2 cm ahead | front rotor -20 % |
| --- | --- | --- | --- |
| rates | 0.1 (0.1) | 5.0 (81) | 4.0 (58) |
| attitude | 7.7 (9.1) | 9.9 (106) | 8.3 (75) |
| actuators | 0.2 (0.2) | 3.7 (60) | 3.0 (43) |

With 4 in place of 2 rad/s the 5.0 are 1.9, with 8 they are 0.8. PX4's and ArduPilot's rate loops have an integral of
their own; there it is left to find what that has not yet.

## Limits that the vehicle keeps

A command of 45 degrees does not keep a vehicle within 45 degrees: ArduPilot turns its rates by at most 1100 deg/s2, and
swung to 59 and 64 in flights. Rates and torques are reduced to those from which `limits.tilt_braking_deg` still stops
the tilt at its limit, in whatever direction it moves. With accelerations that jump by up to 20 m/s2 several times a
second, the tilt of a vehicle with ArduPilot's limit reached 47 to 56 degrees without that, and stays within 45.0 now.
""",
    studies=(
        "studies.agile",
        "studies.loops",
        "studies.sensed",
        "studies.consistency",
        "studies.ellipses",
        "studies.ablation",
        "studies.disturbed",
    ),
)
