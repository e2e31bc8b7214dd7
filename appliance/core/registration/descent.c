/* What a descent does to every point; keyframe.py says why.

   Compiled, because one pass that keeps a point in registers replaces twenty passes of arrays through memory. Whatever
   the numbers are, nothing outside the arrays is touched: places that are far away or no numbers at all are looked up
   at the edge. */

#include "compiled.h"

/* How many points tell the scale of the residuals, and what has become of the gradient. */
enum { SAMPLED = 512, JUDGED = 1024 };

static const int32_t LEAST_SEEN = 64;
static const double TUKEY = 6, LEAST_SCALE = 2, MOST_GAIN = 5, LEAST_LEFT = 0.05, LEAST_RESPONSE = 0.2;

/* How many neighbouring points of speckle count as one beside what is expected of the tissue. */
static const double TOGETHER = 8;

/* From column and row of one level to those of another, xx·column + xy·row + x0 + drag·(share of the drag) and
   yx·column + yy·row + y0 + bend·y² + skew·x·y; greys to gain·grey + bias. */
typedef struct {
    float xx, xy, x0, drag, yx, yy, y0, bend, skew, gain, bias;
    Scale columns, rows, depth;
} Warp;

static inline float clamped(float value, float most) {
    float positive = value > 0 ? value : 0; /* 0 where it is no number */
    return positive < most ? positive : most;
}

static inline double limited(double value, double low, double high) {
    return value > low ? value < high ? value : high : low;
}

static inline Warp warp_of(const Template *points, const Fit *fit) {
    double factor = points->factor, a = points->aspect, c = __builtin_cos(fit->alpha), s = __builtin_sin(fit->alpha);
    double left = (factor - 1) / 2 - points->centre_x, top = (factor - 1) / 2 - points->centre_y;
    double xx = c + fit->give[0] / points->centre_x, xy = -s * a;
    double yx = s / a + fit->give[2] / points->centre_x, yy = c + fit->give[3] / points->centre_y;
    double x = xx * left + xy * top + fit->u_x - left, y = yx * left + yy * top + fit->u_y - top;
    return (Warp){(float)xx, (float)xy, (float)(x / factor), (float)(fit->give[1] / factor), (float)yx, (float)yy,
                  (float)(y / factor), (float)(fit->give[4] / factor), (float)(fit->give[5] / factor),
                  (float)fit->gain, (float)(fit->bias * NINTHS), scale_of(points, points->centre_x),
                  scale_of(points, points->centre_y), depth_of(points)};
}

/* Of so many points: where they are in the picture, −1 … 1, their share of the drag, and where in the other level. */
typedef struct {
    float across[CHUNK], down[CHUNK], drag[CHUNK], x[CHUNK], y[CHUNK];
} Places;

/* Of so many points, every each-th, from the first on. */
static inline void warped(const Template *points, const Warp *warp, int32_t first, int32_t each, int32_t count,
                          Places *places) {
    for (int32_t i = 0; i < count; i++) {
        int32_t at = first + i * each;
        float column = points->column[at], row = points->row[at];
        float across = warp->columns.each * column + warp->columns.first;
        float down = warp->rows.each * row + warp->rows.first;
        float drag = faded(warp->depth.each * row + warp->depth.first);
        places->across[i] = across, places->down[i] = down, places->drag[i] = drag;
        places->x[i] = warp->xx * column + warp->xy * row + warp->x0 + warp->drag * drag;
        places->y[i] = warp->yx * column + warp->yy * row + warp->y0 + down * (warp->bend * down + warp->skew * across);
    }
}

static inline int32_t inside(const Level *level, float x, float y) {
    return (x >= 0) & (y >= 0) & (x <= (float)(level->columns - 1)) & (y <= (float)(level->rows - 1));
}

/* Two neighbours in one load, the left one in the lower half: every processor in compile_core.py is little-endian. */
static inline uint32_t two_at(const int16_t *grey) {
    uint32_t both;
    __builtin_memcpy(&both, grey, sizeof both);
    return both;
}

/* Greys at so many columns and rows, a little aside of them, by bilinear interpolation. */
static inline void interpolated(const Level *level, int32_t count, const float *x, const float *y, float right,
                                float below, float *grey) {
    int32_t corner[CHUNK];
    uint32_t upper[CHUNK], lower[CHUNK];
    float column[CHUNK], row[CHUNK];
    for (int32_t i = 0; i < count; i++) {
        column[i] = clamped(x[i] + right, (float)(level->columns - 1));
        row[i] = clamped(y[i] + below, (float)(level->rows - 1));
        int32_t left = least((int32_t)column[i], level->columns - 2), top = least((int32_t)row[i], level->rows - 2);
        column[i] -= (float)left;
        row[i] -= (float)top;
        corner[i] = top * level->columns + left;
    }
    for (int32_t i = 0; i < count; i++) {
        upper[i] = two_at(level->grey + corner[i]);
        lower[i] = two_at(level->grey + corner[i] + level->columns);
    }
    for (int32_t i = 0; i < count; i++) {
        float a = (float)(int16_t)upper[i], b = (float)((int32_t)upper[i] >> 16);
        float c = (float)(int16_t)lower[i], d = (float)((int32_t)lower[i] >> 16);
        float over = a + column[i] * (b - a), under = c + column[i] * (d - c);
        grey[i] = over + row[i] * (under - over);
    }
}

/* The middle one of count > 0 values, which are put into another order (Hoare 1961). */
static inline float median(float *values, int32_t count) {
    int32_t first = 0, last = count - 1, middle = count / 2;
    while (first < last) {
        float pivot = values[middle];
        int32_t i = first, j = last;
        while (i <= j) {
            while (values[i] < pivot) i++;
            while (values[j] > pivot) j--;
            if (i > j) break;
            float kept = values[i];
            values[i++] = values[j];
            values[j--] = kept;
        }
        if (j < middle) first = i;
        if (middle < i) last = j;
    }
    return values[middle];
}

/* 1 ÷ the residual from which on Tukey's weight is 0, from the median of some residuals in view. */
static inline float inverse_tukey_cutoff(const Template *points, const Level *level, const Warp *warp) {
    int32_t each = stride(points, SAMPLED), seen = 0;
    float residual[SAMPLED];
    for (int32_t first = 0; first < points->count; first += CHUNK * each) {
        int32_t count = at_most(CHUNK, first, points->count, each);
        float grey[CHUNK];
        Places at;
        warped(points, warp, first, each, count, &at);
        interpolated(level, count, at.x, at.y, 0, 0, grey);
        for (int32_t i = 0; i < count; i++) {
            residual[seen] = __builtin_fabsf(grey[i] - (warp->gain * points->grey[first + i * each] + warp->bias));
            seen += inside(level, at.x[i], at.y[i]);
        }
    }
    double scale = seen ? 1.4826 * (double)median(residual, seen) : 0;
    return (float)(1 / (TUKEY * limited(scale, LEAST_SCALE * NINTHS, 1e30)));
}

/* Root of Tukey's weight of a residual: how much it leaves of 1; 0 out of view. */
static inline float root_weight(float residual, float inverse_cutoff, int32_t in) {
    float ratio = residual * inverse_cutoff;
    return clamped(1 - ratio * ratio, 1) * (float)in;
}

/* Adds to the sums of products of the residual, of J without the turn, whose parts along x and y are J's for b₁ and `a1`:
   of the differences across. */
static inline void add_across(const Template *points, const Places *at, int32_t first, int32_t count,
                              const float *product, const float *weight, float *found, float *a1) {
    float u = 0, turn = 0, along = 0, drag = 0, energy = 0;
    for (int32_t i = 0; i < count; i++) {
        float g = points->across[first + i], s = product[i] * g;
        u += s, turn += s * at->down[i], along += s * at->across[i], drag += s * at->drag[i];
        energy += weight[i] * g * g;
    }
    found[0] += u, *a1 += turn, found[3] += along, found[4] += drag, found[PARAMETERS + ACROSS] += energy;
}

/* The same of the differences down. */
static inline void add_down(const Template *points, const Places *at, int32_t first, int32_t count,
                            const float *product, const float *weight, float *found) {
    float u = 0, along = 0, down = 0, bend = 0, skew = 0, energy = 0;
    for (int32_t i = 0; i < count; i++) {
        float g = points->down[first + i], s = product[i] * g, t = s * at->down[i];
        u += s, along += s * at->across[i], down += t, bend += t * at->down[i], skew += t * at->across[i];
        energy += weight[i] * g * g;
    }
    found[1] += u, found[5] += along, found[6] += down, found[7] += bend, found[8] += skew;
    found[PARAMETERS + DOWN] += energy;
}

/* The sums of points first … last. Returns how many are in view. */
static inline int32_t weighted_sums(const Template *points, const Level *level, const Warp *warp, float inverse_cutoff,
                                    int32_t first, int32_t last, float *sums) {
    float step = 0.5f / (float)points->factor, found[SUMS] = {0}, a1 = 0;
    int32_t seen = 0;
    for (; first < last; first += CHUNK) {
        int32_t count = at_most(CHUNK, first, last, 1);
        float grey[CHUNK], product[CHUNK], weight[CHUNK], gain = 0, bias = 0, all = 0;
        Places at;
        warped(points, warp, first, 1, count, &at);
        interpolated(level, count, at.x, at.y, 0, 0, grey);
        for (int32_t i = 0; i < count; i++) {
            float mine = points->grey[first + i], residual = grey[i] - (warp->gain * mine + warp->bias);
            int32_t in = inside(level, at.x[i], at.y[i]);
            float root = root_weight(residual, inverse_cutoff, in);
            seen += in;
            weight[i] = root * root, product[i] = weight[i] * residual;
            gain += product[i] * mine, bias += product[i], all += weight[i];
        }
        found[GAIN] += gain, found[BIAS] += bias, found[SUMS - 1] += all;
        add_across(points, &at, first, count, product, weight, found, &a1);
        add_down(points, &at, first, count, product, weight, found);
    }
    found[2] = (float)(points->centre_x / points->aspect) * found[5] - (float)(points->centre_y * points->aspect) * a1;
    for (int k = 0; k < SUMS; k++) {
        int slope = k < GAIN, square = k >= PARAMETERS && k < SUMS - 1;
        sums[k] = found[k] * (slope ? step : square ? step * step : 1);
    }
    return seen;
}

/* x with A x = b by LDLᵀ, for a symmetric A whose pivots are positive: a direction that has none is not gone. Spoils A. */
static inline void solve(Matrix A, const double *b, double *x) {
    double scaled[PARAMETERS];
    for (int k = 0; k < PARAMETERS; k++) {
        double over = A[k][k] > 0 ? 1 / A[k][k] : 0;
        for (int l = k + 1; l < PARAMETERS; l++) {
            double times = A[l][k] * over;
            for (int m = k + 1; m <= l; m++) A[l][m] -= times * A[m][k];
        }
        for (int l = k + 1; l < PARAMETERS; l++) A[l][k] *= over;
        x[k] = b[k];
        for (int l = 0; l < k; l++) x[k] -= A[k][l] * x[l];
        scaled[k] = x[k] * over;
    }
    for (int k = PARAMETERS - 1; k >= 0; k--) {
        x[k] = scaled[k];
        for (int l = k + 1; l < PARAMETERS; l++) x[k] -= A[l][k] * x[l];
    }
}

/* Change of all parameters by modified residuals (Huber 1981, section 7.8): the normal matrix stays the template's, each
   direction scaled by what the weights leave of it; and what is expected of the tissue draws give to 0. It ends where
   reweighting would. Returns px. */
static inline double stepped(const Template *points, Fit *fit, int32_t cells) {
    double sum[SUMS] = {0}, answer[PARAMETERS], scale[PARAMETERS], step[PARAMETERS], give = 0;
    Matrix A;
    for (int s = 0; s < cells; s++)
        for (int k = 0; k < SUMS; k++) sum[k] += (double)fit->sums[s][k];
    answers(fit, answer);
    double *energy = sum + PARAMETERS;
    double across = energy[0] / points->energy[0], down = energy[1] / points->energy[1];
    double left[] = {across, down, (across + down) / 2, energy[2] / points->energy[2]};
    for (int k = 0; k < PARAMETERS; k++)
        scale[k] = __builtin_sqrt(limited(left[SHOWS[k]], LEAST_LEFT, 1e30));
    for (int k = 0; k < PARAMETERS; k++)
        for (int l = 0; l < PARAMETERS; l++) {
            fit->normal[k][l] = scale[k] * points->normal[k][l] * scale[l];
            A[k][l] = answer[k] * fit->normal[k][l] * answer[l];
        }
    for (int k = 0; k < PARAMETERS; k++) sum[k] *= answer[k];
    double noise = 1 / (TUKEY * (double)fit->inverse_cutoff);
    for (int k = 0; k < GIVES; k++) {
        double stiff = TOGETHER * noise * noise * fit->stiff[k];
        A[RIGID + k][RIGID + k] += stiff;
        sum[RIGID + k] += stiff * fit->give[k];
    }
    solve(A, sum, step);
    for (int k = 0; k < GAIN; k++) fit->step[k] = step[k];
    fit->gain = limited(fit->gain + step[GAIN], 1 / MOST_GAIN, MOST_GAIN);
    fit->bias += step[BIAS] / NINTHS;
    fit->alpha -= step[2];
    double c = __builtin_cos(fit->alpha), s = __builtin_sin(fit->alpha);
    fit->u_x -= c * step[0] - s * points->aspect * step[1];
    fit->u_y -= s / points->aspect * step[0] + c * step[1];
    for (int k = 0; k < GIVES; k++) {
        fit->give[k] -= step[RIGID + k];
        give += step[RIGID + k] * step[RIGID + k];
    }
    return __builtin_sqrt(step[0] * step[0] + step[1] * step[1] + give / 4) +
           (step[2] > 0 ? step[2] : -step[2]) * points->centre_x;
}

static inline double share(double found, double usual) {
    return limited(found / usual, LEAST_RESPONSE, 1);
}

/* Where the speckle has changed, its gradient is another one, and the residual answers less to a step. */
static inline void measure_response(const Template *points, const Level *level, Fit *fit) {
    Warp warp = warp_of(points, fit);
    int32_t each = stride(points, JUDGED), used = 0;
    float xx = 0, xy = 0, yx = 0, yy = 0, square_x = 0, square_y = 0, J[PARAMETERS][CHUNK];
    double sum[PARAMETERS][PARAMETERS] = {{0}};
    for (int32_t first = 0; first < points->count; first += CHUNK * each) {
        int32_t count = at_most(CHUNK, first, points->count, each);
        float grey[CHUNK], right[CHUNK], left[CHUNK], below[CHUNK], above[CHUNK], slope[CHUNK];
        Places at;
        warped(points, &warp, first, each, count, &at);
        interpolated(level, count, at.x, at.y, 0, 0, grey);
        interpolated(level, count, at.x, at.y, 1, 0, right);
        interpolated(level, count, at.x, at.y, -1, 0, left);
        interpolated(level, count, at.x, at.y, 0, 1, below);
        interpolated(level, count, at.x, at.y, 0, -1, above);
        jacobians(points, first, each, count, J);
        used += count;
        for (int32_t i = 0; i < count; i++) {
            float residual = grey[i] - (warp.gain * J[GAIN][i] + warp.bias);
            float root = root_weight(residual, fit->inverse_cutoff, inside(level, at.x[i], at.y[i])), weight = root * root;
            float slope_x = weight * (right[i] - left[i]), slope_y = weight * (below[i] - above[i]);
            slope[i] = root * (5 * root - 4);
            xx += slope_x * J[0][i], xy += slope_x * J[1][i], yx += slope_y * J[0][i], yy += slope_y * J[1][i];
            square_x += weight * J[0][i] * J[0][i], square_y += weight * J[1][i] * J[1][i];
        }
        add_products(J, slope, count, sum);
    }
    normal_matrix(points, used, sum, fit->curvature);
    double c = __builtin_cos(fit->alpha), s = __builtin_sin(fit->alpha);
    double across = c * (double)xx + s * (double)yx, down = c * (double)yy - s * (double)xy;
    double usual_x = fit->gain * (double)square_x + 1e-3, usual_y = fit->gain * (double)square_y + 1e-3;
    fit->response[0] = share(across, usual_x);
    fit->response[1] = share(down, usual_y);
    fit->response[2] = share(across + down, usual_x + usual_y);
}

/* Looks, weighs and goes so many steps, or until one is shorter than enough px; lost where too little is in view.
   responding: 1 where the gradient is to be looked at after each step, and the sums of cells are to be kept. */
void descend(const Template *points, const Level *level, Fit *fit, int32_t most, double enough, int32_t responding) {
    int32_t cells = responding ? CELLS : 1;
    fit->converged = fit->lost = 0;
    while (most-- > 0 && !fit->converged) {
        Warp warp = warp_of(points, fit);
        int32_t seen = 0;
        fit->inverse_cutoff = inverse_tukey_cutoff(points, level, &warp);
        for (int32_t s = 0; s < cells; s++) {
            int32_t first = (int32_t)((int64_t)points->count * s / cells);
            int32_t last = (int32_t)((int64_t)points->count * (s + 1) / cells);
            seen += weighted_sums(points, level, &warp, fit->inverse_cutoff, first, last, fit->sums[s]);
        }
        fit->lost = seen < LEAST_SEEN;
        if (fit->lost) break;
        fit->converged = stepped(points, fit, cells) < enough;
        if (responding) measure_response(points, level, fit);
    }
}

/* correlations: (5,) of some of the points with the level in their places, and reach px of it right, left, below and
   above of them; of those in view, 0 where one side is constant. Returns the share in view. */
double correlate(const Template *points, const Level *level, const Fit *fit, double reach, double *correlations) {
    const float far = (float)reach, right[LOOKS] = {0, far, -far, 0, 0}, below[LOOKS] = {0, 0, 0, far, -far};
    Warp warp = warp_of(points, fit);
    int32_t each = stride(points, JUDGED), seen = 0, all = 0;
    double grey = 0, squares = 0, sum[LOOKS] = {0}, square[LOOKS] = {0}, product[LOOKS] = {0};
    for (int32_t first = 0; first < points->count; first += CHUNK * each) {
        int32_t count = at_most(CHUNK, first, points->count, each);
        float in[CHUNK], mine[CHUNK], value[CHUNK], g = 0, gg = 0;
        Places at;
        warped(points, &warp, first, each, count, &at);
        all += count;
        for (int32_t i = 0; i < count; i++) {
            in[i] = (float)inside(level, at.x[i], at.y[i]);
            mine[i] = in[i] * (float)points->grey[first + i * each];
            seen += in[i] > 0;
            g += mine[i], gg += mine[i] * mine[i];
        }
        grey += (double)g, squares += (double)gg;
        for (int k = 0; k < LOOKS; k++) {
            float s = 0, ss = 0, sg = 0;
            interpolated(level, count, at.x, at.y, right[k], below[k], value);
            for (int32_t i = 0; i < count; i++) {
                float v = in[i] * value[i];
                s += v, ss += v * v, sg += v * mine[i];
            }
            sum[k] += (double)s, square[k] += (double)ss, product[k] += (double)sg;
        }
    }
    for (int k = 0; k < LOOKS; k++) {
        double mine = seen * squares - grey * grey, other = seen * square[k] - sum[k] * sum[k];
        double scale = __builtin_sqrt(mine > 0 ? mine : 0) * __builtin_sqrt(other > 0 ? other : 0);
        correlations[k] = scale > seen ? limited((seen * product[k] - grey * sum[k]) / scale, -1, 1) : 0;
    }
    return all ? (double)seen / all : 0;
}

/* What points.py declares as well, to be compared with it before anything else is called. */
const int32_t layout[] = {PARAMETERS, CELLS, SUMS, LOOKS, sizeof(Level), sizeof(Template), sizeof(Fit)};
