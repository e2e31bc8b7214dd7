"""Solves AX = XB by the closed forms that the second opinion of the replay report needs: no reference, no prior. Pure.

The service decides with `appliance.core.path.solver`. Only what `second_opinion` or the report calls belongs here; the
paper's other methods are in `tests.paper.solvers`.

| file | motion that it needs | what it gives |
|---|---|---|
| scaled_rotation | translations, least squares, QR or polar (Eq. 4) | R_x, λ |
| freehand | motion in all directions, picture plane alone seen | R_x, λ |

The other modules are `sums` (running sums with forgetting, so a new motion costs the same however many came before),
`observability` (singular values in 1°, 1 % and 1 mm) and `motions` (what all methods take and give, and the polarity,
which motion alone cannot show).
"""
