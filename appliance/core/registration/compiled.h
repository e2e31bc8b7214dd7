/* What the compiled files of the core share. points.py declares the structures as well, in the same order. Nothing is
   allocated, and nothing kept between calls, so any number of threads may call at once. Greys are those of a level,
   ninths; px are those of the full picture unless it says of the level. */

#ifndef COMPILED_H
#define COMPILED_H

#include <stdint.h>

/* u_x, u_y, α, then how tissue gives way, then gain and bias. */
enum { RIGID = 3, GIVES = 6, GAIN = RIGID + GIVES, BIAS, PARAMETERS, ENERGIES = 3, CELLS = 48, LOOKS = 5 };
enum { SUMS = PARAMETERS + ENERGIES };

/* Points that are worked on together. */
enum { CHUNK = 128 };
static const double NINTHS = 9;

typedef double Matrix[PARAMETERS][PARAMETERS];

/* (rows, columns), at least 2 × 2. */
typedef struct {
    const int16_t *grey;
    int32_t rows, columns;
} Level;

/* Points of one level, cell by cell. column, row: of the level. across, down: right − left, below − above. factor: px per px of the level. centre_x, centre_y: px of the middle of the picture.
   aspect: λ_axial ÷ λ_lateral. fading: px of depth over which the drag falls to 1/e. normal: Σ J Jᵀ, J = (∂grey/∂u_x,
   ∂u_y, ∂α, ∂give, grey, 1). energy: Σ of (∂u_x², ∂u_y², 1). */
typedef struct {
    const int16_t *column, *row, *across, *down, *grey;
    int32_t count;
    double factor, centre_x, centre_y, aspect, fading;
    double energy[ENERGIES];
    Matrix normal;
} Template;

/* A descent in progress. u: px, alpha: rad, bias: greys. give: px by which tissue gives way beside the rigid motion, of
   x and drag along x, of x, y, y² and x·y along y; x and y are −1 … 1 over the picture. stiff: 1 ÷ the variance, px²,
   that is expected of each. response: share of the keyframe's gradient across, down and around that is still there, of
   what the gain leaves of it. step: the last one, by how much u, α and give were more before it. inverse_cutoff: 1 ÷ the
   residual from which on Tukey's weight was 0 at that step. sums: at that step, over cells of the picture: of weight ·
   residual · J, then of weight · (∂u_x², ∂u_y², 1). normal: the template's, of what the weights leave of it. curvature: Σ
   ψ′ J Jᵀ, ψ′ the slope of Tukey's ψ. */
typedef struct {
    double u_x, u_y, alpha, give[GIVES], gain, bias, stiff[GIVES], response[RIGID], step[GAIN];
    int32_t converged, lost;
    float inverse_cutoff, sums[CELLS][SUMS];
    Matrix normal, curvature;
} Fit;

/* Whether a parameter shows across, down, around or in the greys. */
enum { ACROSS, DOWN, AROUND, GREYS };
static const int SHOWS[PARAMETERS] = {ACROSS, DOWN, AROUND, ACROSS, ACROSS, DOWN, DOWN, DOWN, DOWN, GREYS, GREYS};

/* By how much the residual answers to each parameter, of what it answers in the keyframe. */
static inline void answers(const Fit *fit, double *found) {
    for (int k = 0; k < PARAMETERS; k++) found[k] = k < GAIN ? fit->gain * fit->response[SHOWS[k]] : 1;
}

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

/* Of a column or row of the level where it is in the picture, −1 … 1: each · column + first. */
typedef struct {
    float each, first;
} Scale;

static inline Scale scale_of(const Template *points, double centre) {
    return (Scale){(float)(points->factor / centre), (float)(((points->factor - 1) / 2 - centre) / centre)};
}

/* Of a row of the level the depth in units of the drag's. */
static inline Scale depth_of(const Template *points) {
    return (Scale){(float)(points->factor / points->fading), (float)((points->factor - 1) / 2 / points->fading)};
}

/* Share of the skin's drag at a depth: e^−depth within a hundredth, without a call. */
static inline float faded(float depth) {
    float root = 1 + depth * (0.25f + depth * 0.03125f), square = root * root;
    return 1 / (square * square);
}

/* J of so many points, every each-th, from the first on, with the differences across and down in place of the gradient,
   2 · factor times as large. */
static inline void jacobians(const Template *points, int32_t first, int32_t each, int32_t count,
                             float J[PARAMETERS][CHUNK]) {
    Scale columns = scale_of(points, points->centre_x), rows = scale_of(points, points->centre_y);
    Scale depth = depth_of(points);
    float around = (float)(points->centre_x / points->aspect), over = (float)(points->centre_y * points->aspect);
    for (int32_t i = 0; i < count; i++) {
        int32_t at = first + i * each;
        float x = columns.each * points->column[at] + columns.first, y = rows.each * points->row[at] + rows.first;
        float right = points->across[at], below = points->down[at];
        J[0][i] = right, J[1][i] = below, J[2][i] = around * (below * x) - over * (right * y);
        J[3][i] = right * x, J[4][i] = right * faded(depth.each * points->row[at] + depth.first);
        J[5][i] = below * x, J[6][i] = below * y, J[7][i] = below * y * y, J[8][i] = below * x * y;
        J[GAIN][i] = points->grey[at], J[BIAS][i] = 1;
    }
}

/* Adds Σ weight J Jᵀ of so many points to the lower half of sum. */
void add_products(float J[PARAMETERS][CHUNK], const float *weight, int32_t count, double sum[PARAMETERS][PARAMETERS]);

/* Σ J Jᵀ of all points in units of the gradient, from the lower half of sum: Σ over `used` of them of what jacobians()
   gives. */
void normal_matrix(const Template *points, int32_t used, double sum[PARAMETERS][PARAMETERS], Matrix found);

/* Gauss–Jordan with the largest pivot. Spoils A. Returns 0 where there is no inverse. */
int32_t invert(Matrix A, Matrix inverse);

#endif
