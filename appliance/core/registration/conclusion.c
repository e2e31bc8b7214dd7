/* What the last look of a descent says of the tissue and of the errors; docs/method.md says why. */

#include "compiled.h"

static const double FLOOR[RIGID] = {0.005 * 0.005, 0.005 * 0.005, 2e-5 * 2e-5}; /* px², px², rad² */

/* Beyond which a number is none. */
static const double MOST = 1e300;

typedef double Spread[CELLS][PARAMETERS];

/* The inverse of the fit's normal matrix or curvature A, in units of what the residual answers, with what is expected of
   the terms; 0 where there is none. */
static int32_t uncertainty(const Fit *fit, const double A[PARAMETERS][PARAMETERS], const double *stiff, Matrix inverse) {
    double answer[PARAMETERS];
    Matrix H;
    answers(fit, answer);
    for (int k = 0; k < PARAMETERS; k++)
        for (int l = 0; l < PARAMETERS; l++) H[k][l] = answer[k] * A[k][l] * answer[l] + (k == l ? 1e-6 : 0);
    for (int k = 0; k < GIVES; k++) H[RIGID + k][RIGID + k] += stiff[k];
    return invert(H, inverse);
}

/* The step in so many parameters, the first, that each cell asks for alone. */
static void asked(const Fit *fit, Matrix inverse, int32_t of, Spread spread) {
    double answer[PARAMETERS];
    answers(fit, answer);
    for (int m = 0; m < CELLS; m++)
        for (int k = 0; k < of; k++) {
            spread[m][k] = 0;
            for (int l = 0; l < PARAMETERS; l++)
                spread[m][k] += inverse[k][l] * answer[l] * (double)fit->sums[m][l];
        }
}

/* What all of them ask for together, with what is expected of the terms. */
static void asked_by_all(const Fit *fit, Matrix inverse, const double *stiff, double step[GAIN]) {
    double answer[PARAMETERS], all[PARAMETERS] = {0};
    answers(fit, answer);
    for (int m = 0; m < CELLS; m++)
        for (int l = 0; l < PARAMETERS; l++) all[l] += answer[l] * (double)fit->sums[m][l];
    for (int l = 0; l < GIVES; l++) all[RIGID + l] += stiff[l] * (fit->give[l] + fit->step[RIGID + l]);
    for (int k = 0; k < GAIN; k++) {
        step[k] = 0;
        for (int l = 0; l < PARAMETERS; l++) step[k] += inverse[k][l] * all[l];
    }
}

/* residual², how much a point is worth less than one, neighbours being alike. What all cells ask for alike is no scatter.
   -1 where nothing can be said: before the first look, and where the fit is lost. */
double together(const Fit *fit) {
    const double nothing[GIVES] = {0};
    double square[PARAMETERS] = {0}, step[PARAMETERS] = {0}, each = 0;
    Matrix free;
    Spread spread;
    if (fit->lost || !(fit->inverse_cutoff > 0) || !uncertainty(fit, fit->normal, nothing, free)) return -1;
    asked(fit, free, PARAMETERS, spread);
    for (int m = 0; m < CELLS; m++)
        for (int k = 0; k < PARAMETERS; k++) step[k] += spread[m][k], square[k] += spread[m][k] * spread[m][k];
    for (int k = 0; k < GAIN; k++) {
        square[k] = (square[k] - step[k] * step[k] / CELLS) / (1 - (double)PARAMETERS / CELLS);
        each += square[k] / free[k][k] / GAIN;
    }
    return each >= 0 && each < MOST ? each : -1;
}

/* Takes the last step anew, with (6,) px² expected of the terms. covariance: of u_x, u_y px, α rad. Returns 0 where there
   is none. Far from where it ends Tukey's curvature may point anywhere, so the step is that of the normal matrix. */
int32_t draw(Fit *fit, double aspect, double each, const double *expected, double covariance[RIGID][RIGID]) {
    if (!(each >= 0)) return 0;
    double stiff[GIVES], step[GAIN], pull[PARAMETERS][GIVES], used = PARAMETERS;
    Matrix inverse;
    Spread spread;
    for (int k = 0; k < GIVES; k++) stiff[k] = each / expected[k];
    if (!uncertainty(fit, fit->normal, stiff, inverse)) return 0;
    asked_by_all(fit, inverse, stiff, step);
    if (!uncertainty(fit, fit->curvature, stiff, inverse)) return 0;
    asked(fit, inverse, RIGID, spread);
    for (int k = 0; k < PARAMETERS; k++)
        for (int l = 0; l < GIVES; l++) {
            pull[k][l] = inverse[k][RIGID + l] * stiff[l];
            used -= k == RIGID + l ? pull[k][l] : 0;
        }
    for (int k = 0; k < RIGID; k++)
        for (int l = 0; l < RIGID; l++) {
            covariance[k][l] = k == l ? FLOOR[k] : 0;
            for (int m = 0; m < CELLS; m++) covariance[k][l] += spread[m][k] * spread[m][l] / (1 - used / CELLS);
            for (int i = 0; i < GIVES; i++) covariance[k][l] += pull[k][i] * expected[i] * pull[l][i];
        }
    for (int k = 0; k < GAIN; k++) step[k] = fit->step[k] - step[k];
    double c = __builtin_cos(fit->alpha), s = __builtin_sin(fit->alpha);
    fit->u_x += c * step[0] - s * aspect * step[1];
    fit->u_y += s / aspect * step[0] + c * step[1];
    fit->alpha += step[2];
    for (int k = 0; k < GIVES; k++) fit->give[k] += step[RIGID + k];
    return covariance[0][0] + covariance[1][1] + covariance[2][2] < MOST; /* 0 where it is no number */
}
