"""AX = XB solvers, one file per method, each named after its equation in Boctor et al. 2005. Pure.

The service decides with `appliance.core.path.solver`, which fits the whole path by maximum likelihood near the
reference. The methods here need no reference and no prior: `second_opinion` sets them beside the service's answer in
the replay report, and `make paper` measures them against each other.

| file | motion that it needs | what it gives |
|---|---|---|
| homogeneous | general, two axes (Eq. 3) | R_x, t_x, λ |
| three_translations | three independent translations | R_x, λ |
| two_translations | two translations and their cross product | R_x, λ |
| scaled_rotation | translations, least squares, QR or polar (Eq. 4) | R_x, λ |
| norm_constraint | translations, |R_x t_b| = |t_b|, Horn (Eq. 4) | R_x, λ, biased by tracker noise |
| planar | in-plane translation and turn (Eq. 5–7) | R_x, λ, t_x but for ζ |
| freehand | motion in all directions, picture plane alone seen | R_x, λ |
| likelihood | any of these, from a start | the same with covariance; freehand with tilt also t_z |

Beside them: `sums` (running sums with forgetting, so a new motion costs the same however many came before), `averaging`
(many independent calibrations of one sweep), `observability` (singular values in 1°, 1 % and 1 mm), `motions` (what all
take and give, and the polarity, which motion alone cannot tell).
"""
