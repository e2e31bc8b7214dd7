/* What the compiled files of the core share. points.py declares the structures as well, in the same order. Nothing is
   allocated, and nothing kept between calls, so any number of threads may call at once. Greys are those of a level,
   ninths; px are those of the full picture unless it says of the level. */

#ifndef COMPILED_H
#define COMPILED_H

#include <stdint.h>

enum { PARAMETERS = 5, STRIPS = 24, SUMS = 9, LOOKS = 5 };
static const double NINTHS = 9;

typedef double Matrix[PARAMETERS][PARAMETERS];

/* (rows, columns), at least 2 × 2. */
typedef struct {
    const int16_t *grey;
    int32_t rows, columns;
} Level;

/* Points of one level, top to bottom. column, row: of the level. across, down: right − left, below − above. factor: px
   per px of the level. centre_x, centre_y: px of the middle of the picture. aspect: λ_axial ÷ λ_lateral.
   solver: inverse of Σ J Jᵀ, J = (∂grey/∂u_x, ∂u_y, ∂α, grey, 1). energy: Σ of (∂u_x², ∂u_y², ∂α², 1). */
typedef struct {
    const int16_t *column, *row, *across, *down, *grey;
    int32_t count;
    double factor, centre_x, centre_y, aspect;
    double energy[4];
    Matrix solver;
} Template;

/* A descent in progress. u: px, alpha: rad, bias: greys. response: share of the keyframe's gradient across, down and
   around that is still there, of what the gain leaves of it. inverse_cutoff: 1 ÷ the residual from which on
   Tukey's weight was 0 at the last step. sums: at that step, over strips of the picture from top to bottom: of
   weight · residual · J, then of weight · (∂u_x², ∂u_y², ∂α², 1). curvature: Σ ψ′ J Jᵀ, ψ′ the slope of
   Tukey's ψ. */
typedef struct {
    double u_x, u_y, alpha, gain, bias, response[3];
    int32_t converged, lost;
    float inverse_cutoff, sums[STRIPS][SUMS];
    Matrix curvature;
} Fit;

static inline int32_t least(int32_t a, int32_t b) {
    return a < b ? a : b;
}

/* How many there are from first to before last, taking every each-th; most, where there are more. */
static inline int32_t at_most(int32_t most, int32_t first, int32_t last, int32_t each) {
    return least((last - first + each - 1) / each, most);
}

/* Taking every stride-th point takes about as many as sampled, never more. */
static inline int32_t stride(const Template *points, int32_t sampled) {
    return (points->count + sampled - 1) / sampled;
}

/* centre_x or centre_y in px of the level. */
static inline float on_level(const Template *points, double centre) {
    return (float)((centre - (points->factor - 1) / 2) / points->factor);
}

/* J of a point with the differences across and down in place of the gradient, 2 · factor times as large. */
static inline void jacobian(const Template *points, int32_t at, float *J) {
    float centre_x = on_level(points, points->centre_x), centre_y = on_level(points, points->centre_y);
    float x = (float)(points->factor / points->aspect) * ((float)points->column[at] - centre_x);
    float y = (float)(points->factor * points->aspect) * ((float)points->row[at] - centre_y);
    J[0] = points->across[at], J[1] = points->down[at], J[2] = J[1] * x - J[0] * y, J[3] = points->grey[at], J[4] = 1;
}

/* Σ J Jᵀ of all points in units of the gradient, from the lower half of sum: Σ over `used` of them of what jacobian()
   gives. */
void normal_matrix(const Template *points, int32_t used, float sum[PARAMETERS][PARAMETERS], Matrix found);

/* Gauss–Jordan with the largest pivot. Spoils A. Returns 0 where there is no inverse. */
int32_t invert(Matrix A, Matrix inverse);

#endif
