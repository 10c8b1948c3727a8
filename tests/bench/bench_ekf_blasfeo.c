/* The filter with BLASFEO's panel-major kernels. The model speaks plain arrays, so F and H are
 * packed in each step, as any user of BLASFEO with such a model has to. */
#include "bench_ekf.h"

#include <blasfeo.h>

#ifdef DSE_REAL_IS_float
typedef struct blasfeo_smat matrix;
typedef struct blasfeo_svec vector;
#define allocate_matrix blasfeo_allocate_smat
#define allocate_vector blasfeo_allocate_svec
#define free_matrix     blasfeo_free_smat
#define free_vector     blasfeo_free_svec
#define pack_transposed blasfeo_pack_tran_smat
#define unpack_matrix   blasfeo_unpack_smat
#define pack_vector     blasfeo_pack_svec
#define unpack_vector   blasfeo_unpack_svec
#define gemm_nt         blasfeo_sgemm_nt
#define gemm_nn         blasfeo_sgemm_nn
#define syrk_ln         blasfeo_ssyrk_ln
#define potrf_l         blasfeo_spotrf_l
#define trsm_rltn       blasfeo_strsm_rltn
#define trsv_lnn        blasfeo_strsv_lnn
#define trtr_l          blasfeo_strtr_l
#define gemv_n          blasfeo_sgemv_n
#define diagonal_entry  BLASFEO_SMATEL
#else
typedef struct blasfeo_dmat matrix;
typedef struct blasfeo_dvec vector;
#define allocate_matrix blasfeo_allocate_dmat
#define allocate_vector blasfeo_allocate_dvec
#define free_matrix     blasfeo_free_dmat
#define free_vector     blasfeo_free_dvec
#define pack_transposed blasfeo_pack_tran_dmat
#define unpack_matrix   blasfeo_unpack_dmat
#define pack_vector     blasfeo_pack_dvec
#define unpack_vector   blasfeo_unpack_dvec
#define gemm_nt         blasfeo_dgemm_nt
#define gemm_nn         blasfeo_dgemm_nn
#define syrk_ln         blasfeo_dsyrk_ln
#define potrf_l         blasfeo_dpotrf_l
#define trsm_rltn       blasfeo_dtrsm_rltn
#define trsv_lnn        blasfeo_dtrsv_lnn
#define trtr_l          blasfeo_dtrtr_l
#define gemv_n          blasfeo_dgemv_n
#define diagonal_entry  BLASFEO_DMATEL
#endif

static const struct problem *model_problem;
static int nx, ny; /* 0: nothing allocated */
static dse_real x[BENCH_NX_MAX];
static matrix P, Q, R, F, FP, H, U, S;
static vector x_packed, e_packed;

static void start(const struct problem *problem)
{
    matrix *const squares[] = {&P, &Q, &F, &FP}, *const noises[] = {&R, &S};
    for (int i = 0; i < 4 && nx > 0; i++)
        free_matrix(squares[i]);
    for (int i = 0; i < 2 && nx > 0; i++)
        free_matrix(noises[i]);
    if (nx > 0) {
        free_matrix(&H);
        free_matrix(&U);
        free_vector(&x_packed);
        free_vector(&e_packed);
    }
    model_problem = problem;
    nx = problem->model.nx;
    ny = problem->model.ny;
    for (int i = 0; i < 4; i++)
        allocate_matrix(nx, nx, squares[i]);
    for (int i = 0; i < 2; i++)
        allocate_matrix(ny, ny, noises[i]);
    allocate_matrix(ny, nx, &H);
    allocate_matrix(nx, ny, &U);
    allocate_vector(nx, &x_packed);
    allocate_vector(ny, &e_packed);
    pack_transposed(nx, nx, (dse_real *)problem->P0, nx, &P, 0, 0);
    pack_transposed(nx, nx, (dse_real *)problem->Q, nx, &Q, 0, 0);
    pack_transposed(ny, ny, (dse_real *)problem->R, ny, &R, 0, 0);
    for (int i = 0; i < nx; i++)
        x[i] = 0;
}

static int step(dse_real t, const dse_real *y)
{
    const struct dse_model *model = &model_problem->model;
    dse_real plain[BENCH_NX_MAX * BENCH_NX_MAX], next[BENCH_NX_MAX], e[BENCH_NY_MAX];

    /* x = f(x), P = F P F' + Q (lower triangle, then mirrored) */
    if (model->f(model, t, x, 0, next) || model->dfdx(model, t, x, 0, plain))
        return 1;
    pack_transposed(nx, nx, plain, nx, &F, 0, 0);
    gemm_nt(nx, nx, nx, 1, &F, 0, 0, &P, 0, 0, 0, &FP, 0, 0, &FP, 0, 0);
    syrk_ln(nx, nx, 1, &FP, 0, 0, &F, 0, 0, 1, &Q, 0, 0, &P, 0, 0);
    trtr_l(nx, &P, 0, 0, &P, 0, 0);

    /* U = P H', S = H U + R = L L', W' = U L^-T */
    if (model->h(model, t, next, 0, e) || model->dhdx(model, t, next, 0, plain))
        return 1;
    pack_transposed(nx, ny, plain, nx, &H, 0, 0);
    gemm_nt(nx, ny, nx, 1, &P, 0, 0, &H, 0, 0, 0, &U, 0, 0, &U, 0, 0);
    gemm_nn(ny, ny, nx, 1, &H, 0, 0, &U, 0, 0, 1, &R, 0, 0, &S, 0, 0);
    potrf_l(ny, &S, 0, 0, &S, 0, 0);
    for (int j = 0; j < ny; j++)
        if (!(diagonal_entry(&S, j, j) > 0))
            return 1;
    trsm_rltn(nx, ny, 1, &S, 0, 0, &U, 0, 0, &U, 0, 0);

    /* x = x + W' L^-1 e, P = P - W' W */
    for (int j = 0; j < ny; j++)
        e[j] = y[j] - e[j];
    pack_vector(ny, e, 1, &e_packed, 0);
    pack_vector(nx, next, 1, &x_packed, 0);
    trsv_lnn(ny, &S, 0, 0, &e_packed, 0, &e_packed, 0);
    gemv_n(nx, ny, 1, &U, 0, 0, &e_packed, 0, 1, &x_packed, 0, &x_packed, 0);
    unpack_vector(nx, &x_packed, 0, x, 1);
    syrk_ln(nx, ny, -1, &U, 0, 0, &U, 0, 0, 1, &P, 0, 0, &P, 0, 0);
    trtr_l(nx, &P, 0, 0, &P, 0, 0);
    return 0;
}

static void read(dse_real *out_x, dse_real *out_P)
{
    for (int i = 0; i < nx; i++)
        out_x[i] = x[i];
    unpack_matrix(nx, nx, &P, 0, 0, out_P, nx);
}

const struct contender bench_ekf_blasfeo[1] = {{"blasfeo", 0, 0, start, step, read}};
