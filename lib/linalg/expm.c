/* Matrix exponential and the discretisations that follow from it. */
#include "dse/linalg.h"
#include "dse/math.h"

/* Pade approximant of degree 13, r = q^-1 p with p = V + U, q = V - U (Higham, "The scaling and
 * squaring method for the matrix exponential revisited", SIAM J. Matrix Anal. Appl. 26, 2005):
 * backward error below the unit roundoff of a double for |A|_1 <= THETA. */
static const dse_real pade[14] = {DSE_REAL(64764752532480000.0),
                                  DSE_REAL(32382376266240000.0),
                                  DSE_REAL(7771770303897600.0),
                                  DSE_REAL(1187353796428800.0),
                                  DSE_REAL(129060195264000.0),
                                  DSE_REAL(10559470521600.0),
                                  DSE_REAL(670442572800.0),
                                  DSE_REAL(33522128640.0),
                                  DSE_REAL(1323241920.0),
                                  DSE_REAL(40840800.0),
                                  DSE_REAL(960960.0),
                                  DSE_REAL(16380.0),
                                  DSE_REAL(182.0),
                                  DSE_REAL(1.0)};
#define THETA DSE_REAL(5.371920351148152)

/* Largest absolute column sum; NaN when an entry is NaN. */
static dse_real norm1(int n, const dse_real *A)
{
    dse_real largest = 0;
    for (int j = 0; j < n; j++) {
        dse_real sum = 0;
        for (int i = 0; i < n; i++)
            sum += dse_abs(A[i * n + j]);
        if (sum > largest || sum != sum)
            largest = sum;
    }
    return largest;
}

/* M = a6 A6 + a4 A4 + a2 A2 + a0 I. */
static void polynomial(int n, const dse_real *A2, const dse_real *A4, const dse_real *A6,
                       dse_real a6, dse_real a4, dse_real a2, dse_real a0, dse_real *M)
{
    for (int i = 0; i < n * n; i++)
        M[i] = a6 * A6[i] + a4 * A4[i] + a2 * A2[i];
    for (int i = 0; i < n; i++)
        M[i * n + i] += a0;
}

/* E (n x n) = Q^-1 P; Q is overwritten, P is overwritten. One least-squares solve per column: no
 * pivots, hence no memory for integers. */
static enum dse_status solve_square(int n, dse_real *Q, dse_real *P, dse_real *tau, dse_real *E)
{
    const enum dse_status status = dse_qr(n, n, Q, tau);
    if (status != DSE_OK)
        return status;
    dse_mat_transpose(n, n, P, E); /* columns of P become rows of E .. */
    for (int j = 0; j < n; j++)
        dse_qr_solve(n, n, Q, tau, E + j * n, P + j * n);
    dse_mat_transpose(n, n, P, E); /* .. and columns again */
    return DSE_OK;
}

enum dse_status dse_expm(int n, const dse_real *A, dse_real *E, dse_real *scratch)
{
    const int size = n * n;
    dse_real *As = scratch, *A2 = As + size, *A4 = A2 + size, *A6 = A4 + size;
    dse_real *U = A6 + size, *V = U + size, *W = V + size, *tau = W + size;

    dse_real norm = norm1(n, A);
    if (!dse_is_finite(norm))
        return DSE_ENONFINITE;
    int squarings = 0;
    dse_real scale = 1;
    while (norm > THETA) {
        norm *= DSE_REAL(0.5);
        scale *= DSE_REAL(0.5);
        squarings++;
    }
    for (int i = 0; i < size; i++)
        As[i] = A[i] * scale;

    dse_mat_mul(n, n, n, As, As, A2);
    dse_mat_mul(n, n, n, A2, A2, A4);
    dse_mat_mul(n, n, n, A2, A4, A6);

    /* U = A (A6 (b13 A6 + b11 A4 + b9 A2) + b7 A6 + b5 A4 + b3 A2 + b1 I) */
    polynomial(n, A2, A4, A6, pade[13], pade[11], pade[9], 0, W);
    dse_mat_mul(n, n, n, A6, W, V);
    polynomial(n, A2, A4, A6, pade[7], pade[5], pade[3], pade[1], W);
    dse_axpy(size, 1, V, W);
    dse_mat_mul(n, n, n, As, W, U);
    /* V = A6 (b12 A6 + b10 A4 + b8 A2) + b6 A6 + b4 A4 + b2 A2 + b0 I */
    polynomial(n, A2, A4, A6, pade[12], pade[10], pade[8], 0, W);
    dse_mat_mul(n, n, n, A6, W, V);
    polynomial(n, A2, A4, A6, pade[6], pade[4], pade[2], pade[0], W);
    dse_axpy(size, 1, W, V);

    for (int i = 0; i < size; i++) {
        As[i] = V[i] + U[i]; /* p */
        A2[i] = V[i] - U[i]; /* q */
    }
    const enum dse_status status = solve_square(n, A2, As, tau, E);
    if (status != DSE_OK)
        return status;
    for (int s = 0; s < squarings; s++) { /* exp(A) = exp(A / 2^s)^(2^s) */
        dse_mat_mul(n, n, n, E, E, W);
        for (int i = 0; i < size; i++)
            E[i] = W[i];
    }
    return dse_all_finite(E, size) ? DSE_OK : DSE_ENONFINITE;
}

/* exp([A B; 0 0] h) = [Ad Bd; 0 I]. */
enum dse_status dse_discretise(int n, int nu, const dse_real *A, const dse_real *B, dse_real h,
                               dse_real *Ad, dse_real *Bd, dse_real *scratch)
{
    const int N = n + nu;
    dse_real *M = scratch, *E = M + N * N, *rest = E + N * N;
    for (int i = 0; i < N * N; i++)
        M[i] = 0;
    for (int i = 0; i < n; i++) {
        for (int j = 0; j < n; j++)
            M[i * N + j] = h * A[i * n + j];
        for (int j = 0; j < nu; j++)
            M[i * N + n + j] = h * B[i * nu + j];
    }
    const enum dse_status status = dse_expm(N, M, E, rest);
    if (status != DSE_OK)
        return status;
    for (int i = 0; i < n; i++) {
        for (int j = 0; j < n; j++)
            Ad[i * n + j] = E[i * N + j];
        for (int j = 0; j < nu; j++)
            Bd[i * nu + j] = E[i * N + n + j];
    }
    return DSE_OK;
}

/* Over a short step s: exp([-A Q; 0 A'] s) = [. G; 0 F], Ad(s) = F', Qd(s) = F' G. */
static enum dse_status van_loan_short(int n, const dse_real *A, const dse_real *Q, dse_real s,
                                      dse_real *Ad, dse_real *Qd, dse_real *scratch)
{
    const int N = 2 * n;
    dse_real *M = scratch, *E = M + N * N, *rest = E + N * N;
    for (int i = 0; i < n; i++) {
        for (int j = 0; j < n; j++) {
            M[i * N + j] = -s * A[i * n + j];
            M[i * N + n + j] = s * Q[i * n + j];
            M[(n + i) * N + j] = 0;
            M[(n + i) * N + n + j] = s * A[j * n + i];
        }
    }
    const enum dse_status status = dse_expm(N, M, E, rest);
    if (status != DSE_OK)
        return status;
    dse_real *G = M;
    for (int i = 0; i < n; i++) {
        for (int j = 0; j < n; j++) {
            Ad[i * n + j] = E[(n + j) * N + n + i];
            G[i * n + j] = E[i * N + n + j];
        }
    }
    dse_mat_mul(n, n, n, Ad, G, Qd);
    dse_sym_enforce(n, Qd);
    return DSE_OK;
}

/* The block exponential holds exp(-A h), which overflows for a stiff plant and a long step. It is
 * taken over h / 2^m with |A| h / 2^m <= 1 and then doubled m times, which keeps Qd >= 0:
 *     Qd(2s) = Qd(s) + Ad(s) Qd(s) Ad(s)',   Ad(2s) = Ad(s)^2. */
enum dse_status dse_van_loan(int n, const dse_real *A, const dse_real *Q, dse_real h, dse_real *Ad,
                             dse_real *Qd, dse_real *scratch)
{
    dse_real norm = norm1(n, A) * dse_abs(h);
    if (!dse_is_finite(norm))
        return DSE_ENONFINITE;
    int doublings = 0;
    dse_real step = h;
    while (norm > 1) {
        norm *= DSE_REAL(0.5);
        step *= DSE_REAL(0.5);
        doublings++;
    }
    const enum dse_status status = van_loan_short(n, A, Q, step, Ad, Qd, scratch);
    if (status != DSE_OK)
        return status;
    for (int d = 0; d < doublings; d++) {
        dse_sym_congruence(n, n, Ad, Qd, Qd, Qd, scratch);
        dse_mat_mul(n, n, n, Ad, Ad, scratch);
        for (int i = 0; i < n * n; i++)
            Ad[i] = scratch[i];
    }
    return dse_all_finite(Ad, n * n) && dse_all_finite(Qd, n * n) ? DSE_OK : DSE_ENONFINITE;
}
