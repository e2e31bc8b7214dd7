"""AX = XB solvers that only the paper's page compares, each named after its equation in Boctor et al. 2005. Pure.

Those that the second opinion of the replay report needs are in `appliance.core.handeye`.

| file | motion that it needs | what it gives |
|---|---|---|
| homogeneous | general, two axes (Eq. 3) | R_x, t_x, λ |
| three_translations | three independent translations | R_x, λ |
| two_translations | two translations and their cross product | R_x, λ |
| norm_constraint | translations, |R_x t_b| = |t_b|, Horn (Eq. 4) | R_x, λ, biased by tracker noise |
| planar | in-plane translation and turn (Eq. 5–7) | R_x, λ, t_x but for ζ |
| likelihood | any of these, from a start | the same with covariance; freehand with tilt also t_z |

Beside them `averaging`: many independent calibrations of one sweep.
"""
