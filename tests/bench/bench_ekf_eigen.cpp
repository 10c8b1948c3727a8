// The filter with Eigen's matrices of fixed size.
#include "bench_ekf.h"

#include <Eigen/Dense>

namespace
{

template <int NX, int NY, bool JOSEPH> struct Filter {
    using Vector = Eigen::Matrix<dse_real, NX, 1>;
    using Square = Eigen::Matrix<dse_real, NX, NX, Eigen::RowMajor>;
    // Eigen wants a matrix with one row to be stored by rows, which it is in both cases.
    using Output = Eigen::Matrix<dse_real, NY, NX, Eigen::RowMajor>;
    using Noise = Eigen::Matrix<dse_real, NY, NY>;
    using Sample = Eigen::Matrix<dse_real, NY, 1>;

    static inline const problem *model_problem;
    static inline Vector x;
    static inline Square P, Q;
    static inline Noise R;

    static void start(const problem *p)
    {
        model_problem = p;
        x.setZero();
        P = Eigen::Map<const Square>(p->P0);
        Q = Eigen::Map<const Square>(p->Q);
        for (int i = 0; i < NY; i++)
            for (int j = 0; j < NY; j++)
                R(i, j) = p->R[i * NY + j];
    }

    static int step(dse_real t, const dse_real *y)
    {
        const dse_model *model = &model_problem->model;
        Vector next;
        Square F, FP;
        if (model->f(model, t, x.data(), nullptr, next.data()) ||
            model->dfdx(model, t, x.data(), nullptr, F.data()))
            return 1;
        // x = f(x), P = F P F' + Q, symmetric
        x = next;
        FP.noalias() = F * P;
        P = Q;
        P.noalias() += FP * F.transpose();
        P.template triangularView<Eigen::StrictlyLower>() = P.transpose();

        // S = H P H' + R = L L', W = L^-1 H P
        Sample e;
        Output H, W;
        if (model->h(model, t, x.data(), nullptr, e.data()) ||
            model->dhdx(model, t, x.data(), nullptr, H.data()))
            return 1;
        e = Eigen::Map<const Sample>(y) - e;
        W.noalias() = H * P;
        Noise S = R;
        S.noalias() += W * H.transpose();
        const Eigen::LLT<Noise> llt(S);
        if (llt.info() != Eigen::Success)
            return 1;
        llt.matrixL().solveInPlace(W);
        llt.matrixL().solveInPlace(e);
        x.noalias() += W.transpose() * e; // x = x + W' L^-1 e
        if constexpr (JOSEPH) {
            // K' = L^-T W, A = I - K H, P = A P A' + K R K', symmetric
            llt.matrixU().solveInPlace(W);
            F = Square::Identity();
            F.noalias() -= W.transpose() * H;
            FP.noalias() = F * P;
            P.noalias() = FP * F.transpose();
            const Output RK = R.diagonal().asDiagonal() * W;
            P.noalias() += W.transpose() * RK;
            P.template triangularView<Eigen::StrictlyLower>() = P.transpose();
        } else {
            P.noalias() -= W.transpose() * W; // P = P - W' W
        }
        return 0;
    }

    static void read(dse_real *out_x, dse_real *out_P)
    {
        Eigen::Map<Vector>(out_x, NX) = x;
        Eigen::Map<Square>(out_P, NX, NX) = P;
    }
};

template <int NX, int NY, bool JOSEPH> contender make()
{
    using F = Filter<NX, NY, JOSEPH>;
    return {JOSEPH ? "eigen J" : "eigen", NX, NY, F::start, F::step, F::read};
}

} // namespace

extern "C" {
extern const contender bench_ekf_eigen[5] = {make<2, 1, false>(), make<4, 2, false>(),
                                             make<8, 4, false>(), make<15, 6, false>(),
                                             make<30, 10, false>()};
extern const contender bench_ekf_eigen_joseph[5] = {make<2, 1, true>(), make<4, 2, true>(),
                                                    make<8, 4, true>(), make<15, 6, true>(),
                                                    make<30, 10, true>()};
}
