// The filter with Eigen's matrices of fixed size.
#include "bench_ekf.h"

#include <Eigen/Dense>

namespace
{

template <int NX, int NY> struct Filter {
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
        // P = P - W' W, x = x + W' L^-1 e
        x.noalias() += W.transpose() * e;
        P.noalias() -= W.transpose() * W;
        return 0;
    }

    static void read(dse_real *out_x, dse_real *out_P)
    {
        Eigen::Map<Vector>(out_x, NX) = x;
        Eigen::Map<Square>(out_P, NX, NX) = P;
    }
};

template <int NX, int NY> contender make()
{
    return {"eigen", NX, NY, Filter<NX, NY>::start, Filter<NX, NY>::step, Filter<NX, NY>::read};
}

} // namespace

extern "C" {
extern const contender bench_ekf_eigen[5] = {make<2, 1>(), make<4, 2>(), make<8, 4>(),
                                             make<15, 6>(), make<30, 10>()};
}
