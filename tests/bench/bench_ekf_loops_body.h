/* Body of bench_ekf_loops.c for one pair of NX, NY and one form of the update: JOSEPH 0 or 1
 * (included once per combination, hence no guard). Every inner loop runs along rows, so that the
 * compiler can unroll and vectorise it. */

static struct {
    const struct problem *problem;
    dse_real x[NX], P[NX][NX], Q[NX][NX], R[NY][NY];
} NAME(filter_);

static void NAME(start_)(const struct problem *problem)
{
    NAME(filter_).problem = problem;
    for (int i = 0; i < NX; i++) {
        NAME(filter_).x[i] = 0;
        for (int j = 0; j < NX; j++) {
            NAME(filter_).P[i][j] = problem->P0[i * NX + j];
            NAME(filter_).Q[i][j] = problem->Q[i * NX + j];
        }
    }
    for (int i = 0; i < NY; i++)
        for (int j = 0; j < NY; j++)
            NAME(filter_).R[i][j] = problem->R[i * NY + j];
}

/* C (rows x NX) = A (rows x NX) B. */
static inline void NAME(product_)(int rows, const dse_real (*A)[NX], const dse_real (*B)[NX],
                                  dse_real (*C)[NX])
{
    for (int i = 0; i < rows; i++) {
        dse_real c[NX] = {0};
        for (int k = 0; k < NX; k++)
            for (int j = 0; j < NX; j++)
                c[j] += A[i][k] * B[k][j];
        for (int j = 0; j < NX; j++)
            C[i][j] = c[j];
    }
}

static int NAME(step_)(dse_real t, const dse_real *y)
{
    const struct dse_model *model = &NAME(filter_).problem->model;
    dse_real(*const P)[NX] = NAME(filter_).P;
    dse_real *const x = NAME(filter_).x;
    dse_real F[NX][NX], Ft[NX][NX], FP[NX][NX], H[NY][NX], HP[NY][NX], S[NY][NY];
    dse_real next[NX], e[NY], inverses[NY];

    /* x = f(x), P = F P F' + Q */
    if (model->f(model, t, x, NULL, next) || model->dfdx(model, t, x, NULL, &F[0][0]))
        return 1;
    for (int i = 0; i < NX; i++)
        for (int j = 0; j < NX; j++)
            Ft[j][i] = F[i][j];
    NAME(product_)(NX, (const dse_real(*)[NX])F, (const dse_real(*)[NX])P, FP);
    NAME(product_)(NX, (const dse_real(*)[NX])FP, (const dse_real(*)[NX])Ft, P);
    for (int i = 0; i < NX; i++)
        for (int j = 0; j < NX; j++)
            P[i][j] += NAME(filter_).Q[i][j];
    for (int i = 0; i < NX; i++) {
        x[i] = next[i];
        for (int j = i + 1; j < NX; j++)
            P[j][i] = P[i][j];
    }

    /* S = H P H' + R */
    if (model->h(model, t, x, NULL, e) || model->dhdx(model, t, x, NULL, &H[0][0]))
        return 1;
    NAME(product_)(NY, (const dse_real(*)[NX])H, (const dse_real(*)[NX])P, HP);
    for (int i = 0; i < NY; i++) {
        e[i] = y[i] - e[i];
        for (int j = 0; j <= i; j++) {
            S[i][j] = NAME(filter_).R[i][j];
            for (int k = 0; k < NX; k++)
                S[i][j] += HP[i][k] * H[j][k];
        }
    }
    /* S = L L', W = L^-1 H P, e = L^-1 e, in place */
    for (int j = 0; j < NY; j++) {
        for (int i = j; i < NY; i++)
            for (int k = 0; k < j; k++)
                S[i][j] -= S[i][k] * S[j][k];
        if (!(S[j][j] > 0))
            return 1;
        const dse_real inverse = 1 / SQRT(S[j][j]);
        inverses[j] = inverse;
        for (int i = j; i < NY; i++)
            S[i][j] *= inverse;
        for (int k = 0; k < j; k++) {
            e[j] -= S[j][k] * e[k];
            for (int i = 0; i < NX; i++)
                HP[j][i] -= S[j][k] * HP[k][i];
        }
        e[j] *= inverse;
        for (int i = 0; i < NX; i++)
            HP[j][i] *= inverse;
    }
    /* x = x + W' e */
    for (int k = 0; k < NY; k++)
        for (int i = 0; i < NX; i++)
            x[i] += HP[k][i] * e[k];
#if JOSEPH
    /* K' = L^-T W,  A = I - K H,  P = A P A' + K R K' (R diagonal) */
    for (int j = NY - 1; j >= 0; j--) {
        for (int k = j + 1; k < NY; k++)
            for (int i = 0; i < NX; i++)
                HP[j][i] -= S[k][j] * HP[k][i];
        for (int i = 0; i < NX; i++)
            HP[j][i] *= inverses[j];
    }
    for (int i = 0; i < NX; i++) {
        for (int j = 0; j < NX; j++)
            F[i][j] = i == j;
        for (int k = 0; k < NY; k++)
            for (int j = 0; j < NX; j++)
                F[i][j] -= HP[k][i] * H[k][j];
        for (int j = 0; j < NX; j++)
            Ft[j][i] = F[i][j];
    }
    NAME(product_)(NX, (const dse_real(*)[NX])F, (const dse_real(*)[NX])P, FP);
    NAME(product_)(NX, (const dse_real(*)[NX])FP, (const dse_real(*)[NX])Ft, P);
    for (int i = 0; i < NX; i++)
        for (int k = 0; k < NY; k++)
            for (int j = 0; j < NX; j++)
                P[i][j] += HP[k][i] * NAME(filter_).R[k][k] * HP[k][j];
    for (int i = 0; i < NX; i++)
        for (int j = i + 1; j < NX; j++)
            P[j][i] = P[i][j];
#else
    /* P = P - W' W */
    for (int i = 0; i < NX; i++)
        for (int k = 0; k < NY; k++)
            for (int j = 0; j < NX; j++)
                P[i][j] -= HP[k][i] * HP[k][j];
#endif
    (void)inverses;
    return 0;
}

static void NAME(read_)(dse_real *x, dse_real *P)
{
    for (int i = 0; i < NX; i++) {
        x[i] = NAME(filter_).x[i];
        for (int j = 0; j < NX; j++)
            P[i * NX + j] = NAME(filter_).P[i][j];
    }
}
