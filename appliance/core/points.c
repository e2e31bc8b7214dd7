/* What registration does to every point of a keyframe; registration.py, fit.py and template.py say why.

   Compiled, because one pass that keeps a point in registers replaces twenty passes of arrays through memory. Nothing is
   allocated, nothing is kept between calls, and whatever the numbers are, nothing outside the arrays is touched: places
   that are far away or no numbers at all are looked up at the edge. */

#include <stdint.h>

enum { CHUNK = 256, MOST_SAMPLED = 1024, BINS = 512, LOOKS = 5, PARAMETERS = 5 };

/* Row by row, at least 2 × 2, of uint8 or float. */
typedef struct {
    const void *grey;
    int32_t rows, columns, bytes;
} Picture;

/* x, y: px of the full picture from its centre. across, down, turn: ∂grey/∂(u_x, u_y, α). */
typedef struct {
    const float *x, *y, *across, *down, *turn, *grey;
    int32_t count;
} Points;

/* To columns xx·x + xy·y + x0 and rows yx·x + yy·y + y0 of a picture, and its greys gain·grey + bias. */
typedef struct {
    float xx, xy, x0, yx, yy, y0, gain, bias;
} Warp;

static float grey_at(const Picture *picture, int32_t at) {
    return picture->bytes ? (float)((const uint8_t *)picture->grey)[at] : ((const float *)picture->grey)[at];
}

static float clamped(float value, float most) {
    float positive = value > 0 ? value : 0; /* 0 where it is no number */
    return positive < most ? positive : most;
}

static float magnitude(float value) {
    return value > 0 ? value : -value;
}

static int32_t least(int32_t a, int32_t b) {
    return a < b ? a : b;
}

/* Every how manieth point makes up about as many as sampled, never more. */
static int32_t spacing(const Points *points, int32_t sampled) {
    return (points->count + sampled - 1) / sampled;
}

/* Columns and rows of up to CHUNK points, every each-th from the first on. Returns how many. */
static int32_t warped(const Points *points, const Warp *warp, int32_t first, int32_t each, float *x, float *y) {
    int32_t count = least((points->count - first + each - 1) / each, CHUNK);
    for (int32_t i = 0; i < count; i++) {
        float from_x = points->x[first + i * each], from_y = points->y[first + i * each];
        x[i] = warp->xx * from_x + warp->xy * from_y + warp->x0;
        y[i] = warp->yx * from_x + warp->yy * from_y + warp->y0;
    }
    return count;
}

static int32_t inside(const Picture *picture, float x, float y) {
    return (x >= 0) & (y >= 0) & (x <= (float)(picture->columns - 1)) & (y <= (float)(picture->rows - 1));
}

/* Greys at up to CHUNK columns and rows, a little aside of them, by linear interpolation. */
static void looked_up(const Picture *picture, int32_t count, const float *x, const float *y, float right, float below,
                      float *grey) {
    int32_t corner[CHUNK];
    float column[CHUNK], row[CHUNK], a[CHUNK], b[CHUNK], c[CHUNK], d[CHUNK];
    for (int32_t i = 0; i < count; i++) {
        column[i] = clamped(x[i] + right, (float)(picture->columns - 1));
        row[i] = clamped(y[i] + below, (float)(picture->rows - 1));
        int32_t left = least((int32_t)column[i], picture->columns - 2), top = least((int32_t)row[i], picture->rows - 2);
        column[i] -= (float)left;
        row[i] -= (float)top;
        corner[i] = top * picture->columns + left;
    }
    for (int32_t i = 0; i < count; i++) {
        int32_t upper = corner[i], lower = upper + picture->columns;
        a[i] = grey_at(picture, upper), b[i] = grey_at(picture, upper + 1);
        c[i] = grey_at(picture, lower), d[i] = grey_at(picture, lower + 1);
    }
    for (int32_t i = 0; i < count; i++) {
        float upper = a[i] + column[i] * (b[i] - a[i]), lower = c[i] + column[i] * (d[i] - c[i]);
        grey[i] = upper + row[i] * (lower - upper);
    }
}

/* The middle one of count > 0 values, which are put into another order (Hoare 1961). */
static float median(float *values, int32_t count) {
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

/* 1 ÷ the residual that counts for nothing any more. residual may hold no numbers only if the picture does. */
static float narrowness(const Points *points, const float *seen, const float *residual, int32_t sampled, float tukey,
                        float least_scale) {
    float few[MOST_SAMPLED];
    int32_t count = 0, each = spacing(points, least(sampled, MOST_SAMPLED));
    for (int32_t i = 0; i < points->count; i += each)
        if (seen[i] > 0) few[count++] = magnitude(residual[i]);
    float scale = count ? 1.4826f * median(few, count) : 0;
    return 1 / (tukey * (scale > least_scale ? scale : least_scale));
}

/* Looks every point up. weights: Tukey's of what gain and bias leave unexplained, 0 out of view. weighted: weight times
   that. sums: of weighted · (∂u_x, ∂u_y, ∂α, grey, 1), then of weight · (∂u_x², ∂u_y², ∂α², 1). Returns how many points
   are in view. */
int32_t look(const Points *points, const Picture *picture, const Warp *warp, int32_t sampled, float tukey,
             float least_scale, float *weights, float *weighted, float *sums) {
    int32_t seen = 0;
    for (int32_t first = 0; first < points->count; first += CHUNK) {
        float x[CHUNK], y[CHUNK], grey[CHUNK];
        int32_t count = warped(points, warp, first, 1, x, y);
        looked_up(picture, count, x, y, 0, 0, grey);
        for (int32_t i = 0; i < count; i++) {
            int32_t in = inside(picture, x[i], y[i]);
            seen += in;
            weights[first + i] = (float)in;
            weighted[first + i] = grey[i] - (warp->gain * points->grey[first + i] + warp->bias);
        }
    }
    float narrow = narrowness(points, weights, weighted, sampled, tukey, least_scale);
    float a = 0, b = 0, c = 0, d = 0, e = 0, aa = 0, bb = 0, cc = 0, all = 0;
    for (int32_t i = 0; i < points->count; i++) {
        float ratio = weighted[i] * narrow, rest = 1 - ratio * ratio;
        rest = rest > 0 ? rest : 0;
        float weight = rest * rest * weights[i], product = weight * weighted[i];
        float across = points->across[i], down = points->down[i], turn = points->turn[i];
        weights[i] = weight;
        weighted[i] = product;
        a += product * across, b += product * down, c += product * turn, d += product * points->grey[i], e += product;
        aa += weight * across * across, bb += weight * down * down, cc += weight * turn * turn, all += weight;
    }
    float found[] = {a, b, c, d, e, aa, bb, cc, all};
    for (int k = 0; k < 9; k++) sums[k] = found[k];
    return seen;
}

/* sums over some of the points, of weight · slope of the picture (right − left, below − above) · (∂u_x, ∂u_y) of the
   keyframe: right·x, right·y, below·x, below·y; then of weight · (∂u_x², ∂u_y²). */
void respond(const Points *points, const Picture *picture, const Warp *warp, int32_t sampled, const float *weights,
             float *sums) {
    int32_t each = spacing(points, sampled);
    for (int k = 0; k < 6; k++) sums[k] = 0;
    for (int32_t first = 0; first < points->count; first += CHUNK * each) {
        float x[CHUNK], y[CHUNK], right[CHUNK], left[CHUNK], below[CHUNK], above[CHUNK];
        int32_t count = warped(points, warp, first, each, x, y);
        looked_up(picture, count, x, y, 1, 0, right);
        looked_up(picture, count, x, y, -1, 0, left);
        looked_up(picture, count, x, y, 0, 1, below);
        looked_up(picture, count, x, y, 0, -1, above);
        for (int32_t i = 0; i < count; i++) {
            int32_t at = first + i * each;
            float weight = weights[at], across = points->across[at], down = points->down[at];
            float slope_x = weight * (right[i] - left[i]), slope_y = weight * (below[i] - above[i]);
            sums[0] += slope_x * across, sums[1] += slope_x * down;
            sums[2] += slope_y * across, sums[3] += slope_y * down;
            sums[4] += weight * across * across, sums[5] += weight * down * down;
        }
    }
}

/* normal: (5, 5) Σ ψ′(weight) J Jᵀ over some of the points, times the points for each of those; ψ′ of Tukey's ψ, 1
   everywhere without weights. */
void curvature(const Points *points, int32_t sampled, const float *weights, float *normal) {
    int32_t each = spacing(points, sampled), used = 0;
    float sum[PARAMETERS][PARAMETERS] = {{0}};
    for (int32_t i = 0; i < points->count; i += each, used++) {
        float root = weights ? __builtin_sqrtf(weights[i]) : 1, slope = root * (5 * root - 4);
        float J[PARAMETERS] = {points->across[i], points->down[i], points->turn[i], points->grey[i], 1};
        for (int k = 0; k < PARAMETERS; k++)
            for (int l = 0; l < PARAMETERS; l++) sum[k][l] += slope * J[k] * J[l];
    }
    for (int k = 0; k < PARAMETERS * PARAMETERS; k++) normal[k] = sum[k / PARAMETERS][k % PARAMETERS] * (float)points->count / (float)used;
}

/* scores: (5, n) sums of weighted · (∂u_x, ∂u_y, ∂α, grey, 1) over n strips of as many points each, top to bottom. */
void strips(const Points *points, const float *weighted, int32_t n, float *scores) {
    int32_t length = points->count / n;
    for (int32_t s = 0; s < n; s++) {
        float a = 0, b = 0, c = 0, d = 0, e = 0;
        for (int32_t i = s * length; i < (s + 1) * length; i++) {
            a += weighted[i] * points->across[i], b += weighted[i] * points->down[i];
            c += weighted[i] * points->turn[i], d += weighted[i] * points->grey[i], e += weighted[i];
        }
        scores[s] = a, scores[n + s] = b, scores[2 * n + s] = c, scores[3 * n + s] = d, scores[4 * n + s] = e;
    }
}

/* correlations: (5,) of some of the points with the picture in their places, and reach px right, left, below and above
   of them; of those in view, 0 where one side is constant. Returns the share in view. */
float judge(const Points *points, const Picture *picture, const Warp *warp, int32_t sampled, float reach,
            float *correlations) {
    const float right[LOOKS] = {0, reach, -reach, 0, 0}, below[LOOKS] = {0, 0, 0, reach, -reach};
    int32_t each = spacing(points, sampled), seen = 0, all = 0;
    double grey = 0, squares = 0, sum[LOOKS] = {0}, square[LOOKS] = {0}, product[LOOKS] = {0};
    for (int32_t first = 0; first < points->count; first += CHUNK * each) {
        float x[CHUNK], y[CHUNK], value[CHUNK];
        int32_t count = warped(points, warp, first, each, x, y);
        all += count;
        for (int32_t i = 0; i < count; i++) {
            float in = (float)inside(picture, x[i], y[i]), g = in * points->grey[first + i * each];
            seen += in > 0;
            grey += g, squares += g * g;
        }
        for (int k = 0; k < LOOKS; k++) {
            float s = 0, ss = 0, sg = 0;
            looked_up(picture, count, x, y, right[k], below[k], value);
            for (int32_t i = 0; i < count; i++) {
                float v = (float)inside(picture, x[i], y[i]) * value[i];
                s += v, ss += v * v, sg += v * points->grey[first + i * each];
            }
            sum[k] += s, square[k] += ss, product[k] += sg;
        }
    }
    for (int k = 0; k < LOOKS; k++) {
        double mine = seen * squares - grey * grey, other = seen * square[k] - sum[k] * sum[k];
        double scale = __builtin_sqrt(mine > 0 ? mine : 0) * __builtin_sqrt(other > 0 ? other : 0);
        correlations[k] = scale > seen ? (float)((seen * product[k] - grey * sum[k]) / scale) : 0;
    }
    return all ? (float)seen / (float)all : 0;
}

static float across(const Picture *picture, int32_t at) {
    return grey_at(picture, at + 1) - grey_at(picture, at - 1);
}

static float down(const Picture *picture, int32_t at) {
    return grey_at(picture, at + picture->columns) - grey_at(picture, at - picture->columns);
}

static float steepness(const Picture *picture, int32_t at) {
    return magnitude(across(picture, at)) + magnitude(down(picture, at));
}

/* The steepness below which there is flat_share of the gradient energy; least_steep or more. */
static int32_t threshold(const int32_t *steep, int32_t count, float flat_share, int32_t least_steep) {
    int32_t counts[BINS] = {0};
    for (int32_t i = 0; i < count; i++) counts[steep[i]]++;
    double all = 0, held = 0;
    for (int k = 0; k < BINS; k++) all += (double)counts[k] * k * k;
    int32_t k = 0;
    while (k < BINS - 1 && (held += (double)counts[k] * k * k) < flat_share * all) k++;
    return k > least_steep ? k : least_steep;
}

/* found: flat indices of every pitch-th pixel that is in the mask (0: all are), edge px or more from the sides, and
   steeper than the flat rest, which holds flat_share of the gradient energy, and than least_steep. Returns how many;
   found has room for all pixels that are asked for. */
int32_t structured(const Picture *picture, const uint8_t *mask, int32_t pitch, int32_t edge, float flat_share,
                   int32_t least_steep, int32_t *found) {
    int32_t all = 0, count = 0;
    for (int32_t row = edge; row < picture->rows - edge; row += pitch)
        for (int32_t column = edge; column < picture->columns - edge; column += pitch)
            found[all++] = (int32_t)clamped(steepness(picture, row * picture->columns + column), BINS - 1);
    int32_t enough = threshold(found, all, flat_share, least_steep), i = 0;
    for (int32_t row = edge; row < picture->rows - edge; row += pitch)
        for (int32_t column = edge; column < picture->columns - edge; column += pitch) {
            int32_t at = row * picture->columns + column, steep = found[i++];
            found[count] = at;
            count += (steep > enough) & (!mask || mask[at]);
        }
    return count;
}

/* parts: (6, count) x, y, ∂grey/∂(u_x, u_y, α), grey of as many of the chosen pixels, evenly taken; none is at the sides.
   left, top: where pixel 0 is, px of the full picture from its centre; factor: px of the full picture per px; aspect:
   λ_axial ÷ λ_lateral. */
void describe(const Picture *picture, const int32_t *chosen, int32_t of, int32_t count, float factor, float left,
              float top, float aspect, float *parts) {
    float *x = parts, *y = x + count, *step_x = y + count, *step_y = step_x + count, *turn = step_y + count;
    float *grey = turn + count, half = 0.5f / factor;
    int32_t next = 0, rest = 0; /* next + rest / count = i · of / count */
    for (int32_t i = 0; i < count; i++) {
        int32_t at = chosen[next];
        x[i] = (float)(at % picture->columns) * factor + left;
        y[i] = (float)(at / picture->columns) * factor + top;
        step_x[i] = across(picture, at) * half;
        step_y[i] = down(picture, at) * half;
        turn[i] = step_y[i] * (x[i] / aspect) - step_x[i] * (y[i] * aspect);
        grey[i] = grey_at(picture, at);
        next += of / count;
        rest += of % count;
        if (rest >= count) rest -= count, next++;
    }
}
