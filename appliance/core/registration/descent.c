/* What a descent does to every point; keyframe.py says why.

   Compiled, because one pass that keeps a point in registers replaces twenty passes of arrays through memory. Whatever
   the numbers are, nothing outside the arrays is touched: places that are far away or no numbers at all are looked up
   at the edge. */

#include "compiled.h"

enum { CHUNK = 128 };

/* How many points tell the scale of the residuals, and what has become of the gradient. */
enum { SAMPLED = 512, JUDGED = 1024 };

static const int32_t LEAST_SEEN = 64;
static const double TUKEY = 6, LEAST_SCALE = 2, MOST_GAIN = 5, LEAST_LEFT = 0.05, LEAST_RESPONSE = 0.2;
static const double FLOOR[3] = {0.005 * 0.005, 0.005 * 0.005, 2e-5 * 2e-5}; /* px², px², rad² */

/* From column and row of one level to those of another, xx·column + xy·row + x0 and yx·column + yy·row + y0; greys to
   gain·grey + bias. */
typedef struct {
    float xx, xy, x0, yx, yy, y0, gain, bias;
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
    double x = c * left - s * a * top + fit->u_x - left, y = s / a * left + c * top + fit->u_y - top;
    return (Warp){(float)c, (float)(-s * a), (float)(x / factor), (float)(s / a), (float)c, (float)(y / factor),
                  (float)fit->gain, (float)(fit->bias * NINTHS)};
}

/* Where so many points, every each-th, from the first on, are in the other level. */
static inline void warped(const Template *points, const Warp *warp, int32_t first, int32_t each, int32_t count,
                          float *x, float *y) {
    for (int32_t i = 0; i < count; i++) {
        float column = points->column[first + i * each], row = points->row[first + i * each];
        x[i] = warp->xx * column + warp->xy * row + warp->x0;
        y[i] = warp->yx * column + warp->yy * row + warp->y0;
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
        float x[CHUNK], y[CHUNK], grey[CHUNK];
        warped(points, warp, first, each, count, x, y);
        interpolated(level, count, x, y, 0, 0, grey);
        for (int32_t i = 0; i < count; i++) {
            residual[seen] = __builtin_fabsf(grey[i] - (warp->gain * points->grey[first + i * each] + warp->bias));
            seen += inside(level, x[i], y[i]);
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

/* The sums of points first … last. Returns how many are in view. */
static inline int32_t weighted_sums(const Template *points, const Level *level, const Warp *warp, float inverse_cutoff,
                                    int32_t first, int32_t last, float *sums) {
    float a = 0, b = 0, c = 0, d = 0, e = 0, aa = 0, bb = 0, cc = 0, all = 0, step = 0.5f / (float)points->factor;
    int32_t seen = 0;
    for (; first < last; first += CHUNK) {
        int32_t count = at_most(CHUNK, first, last, 1);
        float x[CHUNK], y[CHUNK], grey[CHUNK];
        warped(points, warp, first, 1, count, x, y);
        interpolated(level, count, x, y, 0, 0, grey);
        for (int32_t i = 0; i < count; i++) {
            float J[PARAMETERS];
            jacobian(points, first + i, J);
            float residual = grey[i] - (warp->gain * J[3] + warp->bias);
            int32_t in = inside(level, x[i], y[i]);
            float root = root_weight(residual, inverse_cutoff, in), weight = root * root, product = weight * residual;
            seen += in;
            a += product * J[0], b += product * J[1], c += product * J[2], d += product * J[3], e += product;
            aa += weight * J[0] * J[0], bb += weight * J[1] * J[1], cc += weight * J[2] * J[2], all += weight;
        }
    }
    float found[SUMS] = {step * a, step * b, step * c, d, e, step * step * aa, step * step * bb, step * step * cc, all};
    for (int k = 0; k < SUMS; k++) sums[k] = found[k];
    return seen;
}

/* Change of u_x, u_y px, α rad, gain, bias by modified residuals (Huber 1981, section 7.8): the normal matrix stays the
   template's, each direction scaled by what the weights leave of it. It ends where reweighting would. Returns px. */
static inline double stepped(const Template *points, Fit *fit) {
    double sum[SUMS] = {0}, step[PARAMETERS] = {0};
    for (int s = 0; s < STRIPS; s++)
        for (int k = 0; k < SUMS; k++) sum[k] += (double)fit->sums[s][k];
    for (int k = 0; k < PARAMETERS; k++) {
        double left = limited(sum[PARAMETERS + (k < 3 ? k : 3)] / points->energy[k < 3 ? k : 3], LEAST_LEFT, 1e30);
        for (int l = 0; l < PARAMETERS; l++) step[k] += points->solver[k][l] * sum[l];
        step[k] /= left * (k < 3 ? fit->gain * fit->response[k] : 1);
    }
    fit->gain = limited(fit->gain + step[3], 1 / MOST_GAIN, MOST_GAIN);
    fit->bias += step[4] / NINTHS;
    fit->alpha -= step[2];
    double c = __builtin_cos(fit->alpha), s = __builtin_sin(fit->alpha);
    fit->u_x -= c * step[0] - s * points->aspect * step[1];
    fit->u_y -= s / points->aspect * step[0] + c * step[1];
    return __builtin_hypot(step[0], step[1]) + (step[2] > 0 ? step[2] : -step[2]) * points->centre_x;
}

static inline double share(double found, double usual) {
    return limited(found / usual, LEAST_RESPONSE, 1);
}

/* Where the speckle has changed, its gradient is another one, and the residual answers less to a step. */
static inline void measure_response(const Template *points, const Level *level, Fit *fit) {
    Warp warp = warp_of(points, fit);
    int32_t each = stride(points, JUDGED), used = 0;
    float xx = 0, xy = 0, yx = 0, yy = 0, square_x = 0, square_y = 0, sum[PARAMETERS][PARAMETERS] = {{0}};
    for (int32_t first = 0; first < points->count; first += CHUNK * each) {
        int32_t count = at_most(CHUNK, first, points->count, each);
        float x[CHUNK], y[CHUNK], grey[CHUNK], right[CHUNK], left[CHUNK], below[CHUNK], above[CHUNK];
        warped(points, &warp, first, each, count, x, y);
        interpolated(level, count, x, y, 0, 0, grey);
        interpolated(level, count, x, y, 1, 0, right);
        interpolated(level, count, x, y, -1, 0, left);
        interpolated(level, count, x, y, 0, 1, below);
        interpolated(level, count, x, y, 0, -1, above);
        used += count;
        for (int32_t i = 0; i < count; i++) {
            float J[PARAMETERS];
            jacobian(points, first + i * each, J);
            float residual = grey[i] - (warp.gain * J[3] + warp.bias);
            float root = root_weight(residual, fit->inverse_cutoff, inside(level, x[i], y[i]));
            float weight = root * root, slope = root * (5 * root - 4);
            float slope_x = weight * (right[i] - left[i]), slope_y = weight * (below[i] - above[i]);
            xx += slope_x * J[0], xy += slope_x * J[1], yx += slope_y * J[0], yy += slope_y * J[1];
            square_x += weight * J[0] * J[0], square_y += weight * J[1] * J[1];
            for (int k = 0; k < PARAMETERS; k++)
                for (int l = 0; l <= k; l++) sum[k][l] += slope * J[k] * J[l];
        }
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
   responding: 1 where the gradient is to be looked at after each step. */
void descend(const Template *points, const Level *level, Fit *fit, int32_t most, double enough, int32_t responding) {
    fit->converged = fit->lost = 0;
    while (most-- > 0 && !fit->converged) {
        Warp warp = warp_of(points, fit);
        int32_t seen = 0;
        fit->inverse_cutoff = inverse_tukey_cutoff(points, level, &warp);
        for (int32_t s = 0; s < STRIPS; s++) {
            int32_t first = (int32_t)((int64_t)points->count * s / STRIPS);
            int32_t last = (int32_t)((int64_t)points->count * (s + 1) / STRIPS);
            seen += weighted_sums(points, level, &warp, fit->inverse_cutoff, first, last, fit->sums[s]);
        }
        fit->lost = seen < LEAST_SEEN;
        if (fit->lost) break;
        fit->converged = stepped(points, fit) < enough;
        if (responding) measure_response(points, level, fit);
    }
}

/* covariance: of u_x, u_y px, α rad: A⁻¹ S A⁻ᵀ ÷ (gain · response)², the sandwich of an M-estimate (Huber 1967), A the
   curvature, S from how much strips of the picture disagree. Neighbouring pixels of speckle and what decorrelates with
   them count once, whatever their number; and a picture in which only a part of the keyframe's contrast is left tells
   as much less of the shift. Returns 0 where nothing can be said: before the first look, and where the fit is lost. */
int32_t covariance(const Fit *fit, double found[3][3]) {
    Matrix curvature, inverse;
    if (fit->lost || !(fit->inverse_cutoff > 0)) return 0;
    for (int k = 0; k < PARAMETERS; k++)
        for (int l = 0; l < PARAMETERS; l++) curvature[k][l] = fit->curvature[k][l] + (k == l ? 1e-6 : 0);
    if (!invert(curvature, inverse)) return 0;
    for (int k = 0; k < 3; k++)
        for (int l = 0; l < 3; l++) found[k][l] = k == l ? FLOOR[k] : 0;
    double told = fit->gain * fit->gain * (1 - (double)PARAMETERS / STRIPS);
    for (int s = 0; s < STRIPS; s++) {
        double spread[3] = {0};
        for (int k = 0; k < 3; k++)
            for (int l = 0; l < PARAMETERS; l++) spread[k] += inverse[k][l] * (double)fit->sums[s][l];
        for (int k = 0; k < 3; k++)
            for (int l = 0; l < 3; l++)
                found[k][l] += spread[k] * spread[l] / (told * fit->response[k] * fit->response[l]);
    }
    return found[0][0] + found[1][1] + found[2][2] < 1e300; /* 0 where it is no number */
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
        float x[CHUNK], y[CHUNK], in[CHUNK], mine[CHUNK], value[CHUNK], g = 0, gg = 0;
        warped(points, &warp, first, each, count, x, y);
        all += count;
        for (int32_t i = 0; i < count; i++) {
            in[i] = (float)inside(level, x[i], y[i]);
            mine[i] = in[i] * (float)points->grey[first + i * each];
            seen += in[i] > 0;
            g += mine[i], gg += mine[i] * mine[i];
        }
        grey += (double)g, squares += (double)gg;
        for (int k = 0; k < LOOKS; k++) {
            float s = 0, ss = 0, sg = 0;
            interpolated(level, count, x, y, right[k], below[k], value);
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
const int32_t layout[] = {PARAMETERS, STRIPS, SUMS, LOOKS, sizeof(Level), sizeof(Template), sizeof(Fit)};
