/* The levels of a picture; pyramid.py says why. */

#include "compiled.h"

enum { SPAN = 1024 };

static inline int32_t mirrored(int32_t at, int32_t count) {
    int32_t inside = at < 0 ? 1 : at < count ? at : count - 2;
    return count > 1 ? inside : 0;
}

/* One row of sums of 3 × 3; outside, the picture is mirrored at its outermost pixels. */
static inline void smoothed(const uint8_t *restrict picture, int32_t rows, int32_t columns, int32_t row,
                            int16_t *restrict sums) {
    const uint8_t *here = picture + (int64_t)row * columns;
    const uint8_t *above = picture + (int64_t)mirrored(row - 1, rows) * columns;
    const uint8_t *below = picture + (int64_t)mirrored(row + 1, rows) * columns;
    for (int32_t first = 0; first < columns; first += SPAN) {
        int32_t count = least(columns - first, SPAN);
        int32_t left = mirrored(first - 1, columns), right = mirrored(first + count, columns);
        int16_t vertical[SPAN + 2];
        for (int32_t i = 0; i < count; i++)
            vertical[i + 1] = (int16_t)(above[first + i] + here[first + i] + below[first + i]);
        vertical[0] = (int16_t)(above[left] + here[left] + below[left]);
        vertical[count + 1] = (int16_t)(above[right] + here[right] + below[right]);
        for (int32_t i = 0; i < count; i++)
            sums[first + i] = (int16_t)(vertical[i] + vertical[i + 1] + vertical[i + 2]);
    }
}

/* One row of the level of half the size: means of 2 × 2, of the level as it is, or of its means of 3 × 3. 16 bits hold
   the 18 greys, of at most 9 · 255 ninths, that are added up. */
static inline __attribute__((always_inline)) void halved(const int16_t *restrict level, int32_t rows, int32_t columns,
                                                         int32_t row, int32_t smooth, int16_t *restrict half) {
    const int16_t *upper = level + (int64_t)2 * row * columns, *lower = upper + columns;
    const int16_t *above = level + (int64_t)mirrored(2 * row - 1, rows) * columns;
    const int16_t *below = level + (int64_t)mirrored(2 * row + 2, rows) * columns;
    for (int32_t first = 0; first < columns - 1; first += SPAN) {
        int32_t count = least(columns - first, SPAN), left = mirrored(first - 1, columns);
        int32_t right = mirrored(first + count, columns);
        uint16_t vertical[SPAN + 2];
        union { uint16_t one[SPAN]; uint32_t two[SPAN / 2]; } sum; /* pairs, added many at a time */
        for (int32_t i = 0; i < count; i++)
            vertical[i + 1] = (uint16_t)((1 + smooth) * (upper[first + i] + lower[first + i]) +
                                        smooth * (above[first + i] + below[first + i]));
        vertical[0] = (uint16_t)(2 * (upper[left] + lower[left]) + above[left] + below[left]);
        vertical[count + 1] = (uint16_t)(2 * (upper[right] + lower[right]) + above[right] + below[right]);
        for (int32_t i = 0; i < count; i++)
            sum.one[i] = (uint16_t)(vertical[i + 1] + smooth * (vertical[i] + vertical[i + 2]));
        uint32_t all = smooth ? 36 : 4;
        for (int32_t i = 0; i < count / 2; i++)
            half[first / 2 + i] = (int16_t)(((sum.two[i] & 0xffff) + (sum.two[i] >> 16) + all / 2) / all);
    }
}

/* found: one level after the other, each row by row: (rows, columns) sums of the 3 × 3 around each pixel, then so many
   times half the size. */
void levels(const uint8_t *picture, int32_t rows, int32_t columns, int32_t halvings, int16_t *found) {
    for (int32_t row = 0; row < rows; row++) smoothed(picture, rows, columns, row, found + (int64_t)row * columns);
    for (int32_t k = 0; k < halvings; k++) {
        int16_t *half = found + (int64_t)rows * columns, *out = half;
        for (int32_t row = 0; row < rows / 2; row++, out += columns / 2)
            k ? halved(found, rows, columns, row, 1, out) : halved(found, rows, columns, row, 0, out);
        found = half, rows /= 2, columns /= 2;
    }
}
