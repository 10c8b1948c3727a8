/* Every kernel of dse/linalg.h on fixed pseudo-random matrices of several sizes. */
#include "dse/linalg.h"

#include "numbers.h"
#include "report.h"

#define MAX    9         /* largest dimension */
#define WIDE   (2 * MAX) /* columns of the array step */
#define SQUARE (MAX * MAX)

static struct {
    dse_real A[SQUARE], B[SQUARE], C[SQUARE], S[SQUARE], L[SQUARE], D[MAX], x[MAX], b[WIDE];
    dse_real wide[MAX * WIDE], Ad[SQUARE], Bd[SQUARE];
    dse_real scratch[DSE_VAN_LOAN_SCRATCH(MAX) + DSE_DISCRETISE_SCRATCH(MAX, MAX)];
    int pivots[MAX];
} w;

static void copy(int n, const dse_real *from, dse_real *to)
{
    for (int i = 0; i < n; i++)
        to[i] = from[i];
}

static void products(int n)
{
    dse_mat_mul(n, n, n, w.A, w.B, w.C);
    report_digest("mat_mul", n * n, w.C);
    dse_mat_mul_nt(n, n, n, w.A, w.B, w.C);
    report_digest("mat_mul_nt", n * n, w.C);
    dse_mat_mul_tn(n, n, n, w.A, w.B, w.C);
    report_digest("mat_mul_tn", n * n, w.C);
    dse_mat_vec(n, n, w.A, w.x, w.D);
    report_digest("mat_vec", n, w.D);
    dse_mat_tvec(n, n, w.A, w.x, w.D);
    report_digest("mat_tvec", n, w.D);
    report_real("dot", dse_dot(n * n, w.A, w.B));
    report_real("norm2", dse_norm2(n * n, w.A));
    report_real("norm_max", dse_norm_max(n * n, w.A));
}

/* S = A A' + I, symmetric positive definite, then P = B S B' + S. */
static void symmetric(int n)
{
    dse_mat_identity(n, w.C);
    dse_sym_congruence(n, n, w.A, w.C, w.C, w.S, w.scratch);
    report_digest("sym_congruence", n * n, w.S);
    dse_sym_rank1(n, DSE_REAL(0.25), w.x, w.S);
    report_digest("sym_rank1", n * n, w.S);
}

static void definite(int n)
{
    report_int("cholesky status", dse_cholesky(n, w.S, w.L));
    report_digest("cholesky", n * n, w.L);
    copy(n * n, w.B, w.C);
    dse_cholesky_solve(n, w.L, n, w.C);
    report_digest("cholesky_solve", n * n, w.C);
    report_int("ldl status", dse_ldl(n, w.S, w.L, w.D));
    report_digest("ldl L", n * n, w.L);
    report_digest("ldl D", n, w.D);
    copy(n, w.x, w.b);
    dse_ldl_solve(n, w.L, w.D, 1, w.b);
    report_digest("ldl_solve", n, w.b);
    w.S[0] = -1;
    report_int("cholesky of an indefinite matrix", dse_cholesky(n, w.S, w.L));
}

static void general(int n)
{
    copy(n * n, w.A, w.C);
    report_int("lu status", dse_lu(n, w.C, w.pivots));
    copy(n, w.x, w.b);
    dse_lu_solve(n, w.C, w.pivots, 1, w.b);
    report_digest("lu_solve", n, w.b);
    copy(n * n, w.A, w.C);
    report_int("qr status", dse_qr(n, n, w.C, w.D));
    report_digest("qr", n * n, w.C);
    copy(n, w.x, w.b);
    dse_qr_solve(n, n, w.C, w.D, w.b, w.L);
    report_digest("qr_solve", n, w.L);
    dse_lq_lower(n, 2 * n, w.wide, w.L);
    report_digest("lq_lower", n * n, w.L);
}

static void exponentials(int n)
{
    report_int("expm status", dse_expm(n, w.A, w.Ad, w.scratch));
    report_digest("expm", n * n, w.Ad);
    report_int("discretise status",
               dse_discretise(n, n, w.A, w.B, DSE_REAL(0.125), w.Ad, w.Bd, w.scratch));
    report_digest("discretise A", n * n, w.Ad);
    report_digest("discretise B", n * n, w.Bd);
    dse_mat_identity(n, w.C);
    report_int("van_loan status",
               dse_van_loan(n, w.A, w.C, DSE_REAL(0.125), w.Ad, w.Bd, w.scratch));
    report_digest("van_loan A", n * n, w.Ad);
    report_digest("van_loan Q", n * n, w.Bd);
    if (n == 3)
        report_vector("van_loan Q", n * n, w.Bd);
}

int main(void)
{
    struct numbers numbers = {2016};
    for (int n = 1; n <= MAX; n += n < 4 ? 1 : 5) {
        report_int("n", n);
        numbers_fill(&numbers, n * n, w.A);
        numbers_fill(&numbers, n * n, w.B);
        numbers_fill(&numbers, n, w.x);
        numbers_fill(&numbers, 2 * n * n, w.wide);
        products(n);
        symmetric(n);
        definite(n);
        general(n);
        exponentials(n);
    }
    return report_verdict();
}
