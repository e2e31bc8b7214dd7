/* Which points of a level are looked at, and what is worked out of them once; template.py says why. */

#include "compiled.h"

enum { BINS = 512 };

/* Upright bands in which points are listed, so that a run of neighbours in the list is a cell of the picture, not a
   strip across it: 6 bands of 8 cells. */
enum { BANDS = 6 };

/* How many pixels tell what is flat, how many points tell the solver. */
enum { TOLD = 16384, PREPARED = 1024 };

/* No grey is steeper. */
enum { STEEPEST = 1 << 16 };

static inline int32_t across(const Level *level, int32_t at) {
    return level->grey[at + 1] - level->grey[at - 1];
}

static inline int32_t down(const Level *level, int32_t at) {
    return level->grey[at + level->columns] - level->grey[at - level->columns];
}

/* In ninths, of so many pixels from one on, every pitch-th. Unsigned, for it is an index: what is too
   large wraps, which takes greys beyond ± 16000. */
static inline void steepness(const Level *level, int32_t at, int32_t pitch, int32_t count, uint16_t *steep) {
    for (int32_t i = 0; i < count; i++, at += pitch)
        steep[i] = (uint16_t)(__builtin_abs(across(level, at)) + __builtin_abs(down(level, at)));
}

/* The steepness in greys below which there is flat_share of the gradient energy; least_steep or more. */
static int32_t threshold(const int32_t *counts, double flat_share, int32_t least_steep) {
    double all = 0, held = 0;
    for (int i = 0; i < BINS; i++) all += (double)counts[i] * i * i;
    int32_t k = 0;
    while (k < BINS - 1 && (held += (double)counts[k] * k * k) < flat_share * all) k++;
    return k > least_steep ? k : least_steep;
}

/* found: flat indices, upright band by band, of every pitch-th pixel that is in the mask (0: all are), edge px or more
   from the sides, and steeper than the flat rest, which holds flat_share of the gradient energy, as some of the rows
   tell, and than least_steep greys. Returns how many; found has room for all pixels that are asked for. No number makes
   it loop for ever or overflow: without a pitch and an edge of at least 1, or of a level beyond 32767 px, it finds
   nothing. */
int32_t structured(const Level *level, const uint8_t *mask, int32_t pitch, int32_t edge, double flat_share,
                   int32_t least_steep, int32_t *found) {
    if (least(least(pitch, edge), least(level->rows, level->columns)) < 1) return 0;
    if (level->rows > INT16_MAX || level->columns > INT16_MAX) return 0;
    pitch = least(pitch, INT16_MAX), edge = least(edge, INT16_MAX), least_steep = least(least_steep, STEEPEST);
    int32_t last_row = level->rows - edge, last_column = level->columns - edge, counts[BINS] = {0}, count = 0;
    if (last_row <= edge || last_column <= edge) return 0;
    int32_t apart = pitch * (1 + (last_row - edge) / pitch * ((last_column - edge) / pitch) / TOLD);
    uint16_t steep[CHUNK];
    for (int32_t row = edge; row < last_row; row += apart)
        for (int32_t column = edge; column < last_column; column += CHUNK * pitch) {
            int32_t some = at_most(CHUNK, column, last_column, pitch);
            steepness(level, row * level->columns + column, pitch, some, steep);
            for (int32_t i = 0; i < some; i++) counts[least(steep[i] / (int32_t)NINTHS, BINS - 1)]++;
        }
    int32_t enough = (threshold(counts, flat_share, least_steep) + 1) * (int32_t)NINTHS;
    int32_t band = ((last_column - edge) / pitch / BANDS + 1) * pitch;
    for (int32_t left = edge; left < last_column; left += band)
        for (int32_t row = edge; row < last_row; row += pitch) {
            int32_t right = least(left + band, last_column);
            for (int32_t column = left; column < right; column += CHUNK * pitch) {
                int32_t some = at_most(CHUNK, column, right, pitch);
                int32_t at = row * level->columns + column;
                steepness(level, at, pitch, some, steep);
                for (int32_t i = 0; i < some; i++, at += pitch) {
                    found[count] = at;
                    count += (steep[i] >= enough) & (!mask || mask[at]);
                }
            }
        }
    return count;
}

/* parts: (5, count) column, row, across, down, grey of as many of the chosen pixels, evenly taken; none is at the
   sides. */
void describe(const Level *level, const int32_t *chosen, int32_t of, int32_t count, int16_t *parts) {
    int32_t next = 0, rest = 0; /* next + rest / count = i · of / count */
    for (int32_t i = 0; i < count; i++) {
        int32_t at = chosen[next];
        parts[i] = (int16_t)(at % level->columns);
        parts[i + count] = (int16_t)(at / level->columns);
        parts[i + 2 * count] = (int16_t)across(level, at);
        parts[i + 3 * count] = (int16_t)down(level, at);
        parts[i + 4 * count] = level->grey[at];
        next += of / count;
        rest += of % count;
        if (rest >= count) rest -= count, next++;
    }
}

void add_products(float J[PARAMETERS][CHUNK], const float *weight, int32_t count, double sum[PARAMETERS][PARAMETERS]) {
    for (int k = 0; k < PARAMETERS; k++)
        for (int l = 0; l <= k; l++) {
            float all = 0;
            for (int32_t i = 0; i < count; i++) all += weight[i] * J[k][i] * J[l][i];
            sum[k][l] += (double)all;
        }
}

void normal_matrix(const Template *points, int32_t used, double sum[PARAMETERS][PARAMETERS], Matrix found) {
    for (int k = 0; k < PARAMETERS; k++)
        for (int l = 0; l < PARAMETERS; l++) {
            double unit = (k < GAIN ? 0.5 / points->factor : 1) * (l < GAIN ? 0.5 / points->factor : 1);
            found[k][l] = unit * sum[k > l ? k : l][k > l ? l : k] * points->count / used;
        }
}

int32_t invert(Matrix A, Matrix inverse) {
    for (int k = 0; k < PARAMETERS; k++)
        for (int l = 0; l < PARAMETERS; l++) inverse[k][l] = k == l;
    for (int k = 0; k < PARAMETERS; k++) {
        int best = k;
        for (int r = k + 1; r < PARAMETERS; r++)
            if (A[r][k] * A[r][k] > A[best][k] * A[best][k]) best = r;
        double pivot = A[best][k];
        if (!(pivot * pivot > 0)) return 0;
        for (int l = 0; l < PARAMETERS; l++) {
            double a = A[best][l], b = inverse[best][l];
            A[best][l] = A[k][l], inverse[best][l] = inverse[k][l];
            A[k][l] = a / pivot, inverse[k][l] = b / pivot;
        }
        for (int r = 0; r < PARAMETERS; r++) {
            double times = r == k ? 0 : A[r][k];
            for (int l = 0; l < PARAMETERS; l++) A[r][l] -= times * A[k][l], inverse[r][l] -= times * inverse[k][l];
        }
    }
    return 1;
}

/* Fills in normal, which some of the points give well enough: it steers, it does not judge; and energy. */
void prepare(Template *points) {
    int32_t each = stride(points, PREPARED), used = 0;
    float J[PARAMETERS][CHUNK], one[CHUNK];
    double sum[PARAMETERS][PARAMETERS] = {{0}}, unit = 0.25 / (points->factor * points->factor);
    double energy[ENERGIES] = {0, 0, points->count};
    for (int32_t i = 0; i < CHUNK; i++) one[i] = 1;
    for (int32_t first = 0; first < points->count; first += CHUNK * each) {
        int32_t count = at_most(CHUNK, first, points->count, each);
        jacobians(points, first, each, count, J);
        add_products(J, one, count, sum);
        used += count;
    }
    for (int32_t first = 0; first < points->count; first += CHUNK) {
        int32_t last = least(first + CHUNK, points->count);
        float across = 0, down = 0;
        for (int32_t i = first; i < last; i++) {
            float right = points->across[i], below = points->down[i];
            across += right * right, down += below * below;
        }
        energy[0] += unit * (double)across, energy[1] += unit * (double)down;
    }
    normal_matrix(points, used, sum, points->normal);
    for (int k = 0; k < PARAMETERS; k++) points->normal[k][k] += 1e-9 * points->normal[k][k] + 1e-9;
    for (int k = 0; k < ENERGIES; k++) points->energy[k] = energy[k] > 1e-9 ? energy[k] : 1e-9;
}
