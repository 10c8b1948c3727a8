/* Matrices of the observers of the two descriptor plants as `dse design uio descriptor_uio` and
 * `dse design functional descriptor_fo` write them (with --law printed where it says so). */
#include "observer_designs.h"

#include <stddef.h>

static const dse_real uio_Lambda[6][1] = {
    {DSE_REAL(-1.0)},
    {DSE_REAL(-1.0)},
    {DSE_REAL(-1.5000000000000004)},
    {DSE_REAL(-1.0)},
    {DSE_REAL(-2.0000000000000004)},
    {DSE_REAL(-2.5)},
};
static const dse_real uio_L[6][2] = {
    {DSE_REAL(-1.0), DSE_REAL(0.0)},
    {DSE_REAL(3.000000000000001), DSE_REAL(-2.0000000000000004)},
    {DSE_REAL(0.7500000000000009), DSE_REAL(-1.0000000000000002)},
    {DSE_REAL(0.0), DSE_REAL(-1.0)},
    {DSE_REAL(2.000000000000001), DSE_REAL(-1.0000000000000007)},
    {DSE_REAL(1.4999999999999996), DSE_REAL(-4.75)},
};
static const dse_real uio_H[6][2] = {
    {DSE_REAL(-1.0), DSE_REAL(1.0)},
    {DSE_REAL(1.0), DSE_REAL(-1.0000000000000002)},
    {DSE_REAL(-1.0000000000000004), DSE_REAL(1.0)},
    {DSE_REAL(-1.0000000000000009), DSE_REAL(1.0)},
    {DSE_REAL(1.0000000000000004), DSE_REAL(1.0)},
    {DSE_REAL(1.4999999999999998), DSE_REAL(-1.5)},
};
static const dse_real uio_M[6][4] = {
    {DSE_REAL(0.0), DSE_REAL(1.0), DSE_REAL(0.0), DSE_REAL(0.0)},
    {DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(1.0), DSE_REAL(0.0)},
    {DSE_REAL(0.0), DSE_REAL(1.0), DSE_REAL(0.0), DSE_REAL(0.0)},
    {DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(1.0), DSE_REAL(0.0)},
    {DSE_REAL(0.0), DSE_REAL(1.0), DSE_REAL(0.0), DSE_REAL(0.0)},
    {DSE_REAL(-1.0), DSE_REAL(0.0), DSE_REAL(1.0), DSE_REAL(0.0)},
};
static const dse_real uio_N[6][8] = {
    {DSE_REAL(1.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(-1.0), DSE_REAL(0.0), DSE_REAL(1.0),
     DSE_REAL(0.0), DSE_REAL(0.0)},
    {DSE_REAL(1.0), DSE_REAL(0.0), DSE_REAL(-1.0), DSE_REAL(1.0), DSE_REAL(-1.0),
     DSE_REAL(1.0000000000000002), DSE_REAL(0.0), DSE_REAL(0.0)},
    {DSE_REAL(0.0), DSE_REAL(1.0), DSE_REAL(-1.5), DSE_REAL(0.0), DSE_REAL(1.0), DSE_REAL(0.0),
     DSE_REAL(0.0), DSE_REAL(0.0)},
    {DSE_REAL(0.0), DSE_REAL(1.0), DSE_REAL(1.0), DSE_REAL(0.0), DSE_REAL(-1.0), DSE_REAL(0.0),
     DSE_REAL(0.0), DSE_REAL(0.0)},
    {DSE_REAL(0.0), DSE_REAL(1.0), DSE_REAL(-2.0), DSE_REAL(0.0), DSE_REAL(1.0), DSE_REAL(0.0),
     DSE_REAL(0.0), DSE_REAL(0.0)},
    {DSE_REAL(0.9999999999999997), DSE_REAL(-1.5000000000000004), DSE_REAL(0.0), DSE_REAL(1.0),
     DSE_REAL(0.0), DSE_REAL(1.5000000000000004), DSE_REAL(0.0), DSE_REAL(0.0)},
};
static const dse_real uio_J[6][8] = {
    {DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(-1.0), DSE_REAL(0.0), DSE_REAL(1.0), DSE_REAL(0.0),
     DSE_REAL(-1.0), DSE_REAL(0.0)},
    {DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0),
     DSE_REAL(-1.0), DSE_REAL(0.0)},
    {DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0),
     DSE_REAL(-1.0), DSE_REAL(0.0)},
    {DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(1.0), DSE_REAL(0.0), DSE_REAL(-1.0), DSE_REAL(0.0),
     DSE_REAL(-1.0), DSE_REAL(0.0)},
    {DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(-2.0), DSE_REAL(0.0), DSE_REAL(1.0), DSE_REAL(0.0),
     DSE_REAL(-1.0), DSE_REAL(0.0)},
    {DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0),
     DSE_REAL(-1.0), DSE_REAL(0.0)},
};
static const dse_real uio_z0[6][1] = {
    {DSE_REAL(60.0)}, {DSE_REAL(-30.0)}, {DSE_REAL(-50.0)},
    {DSE_REAL(40.0)}, {DSE_REAL(30.0)},  {DSE_REAL(-20.0)},
};
static const dse_real uio_Pi[6][1] = {
    {DSE_REAL(0.5)},
    {DSE_REAL(0.5)},
    {DSE_REAL(0.33333333333333326)},
    {DSE_REAL(0.5)},
    {DSE_REAL(0.24999999999999994)},
    {DSE_REAL(0.2)},
};
static const dse_real uio_C2[6][12] = {
    {DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(1.0), DSE_REAL(1.0), DSE_REAL(0.0),
     DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(1.0), DSE_REAL(1.0)},
    {DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(1.0), DSE_REAL(1.0), DSE_REAL(0.0),
     DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(1.0), DSE_REAL(1.0), DSE_REAL(0.0), DSE_REAL(0.0)},
    {DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(1.0), DSE_REAL(0.0), DSE_REAL(0.0),
     DSE_REAL(1.0), DSE_REAL(0.0), DSE_REAL(1.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0)},
    {DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(1.0), DSE_REAL(0.0), DSE_REAL(1.0),
     DSE_REAL(0.0), DSE_REAL(1.0), DSE_REAL(1.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0)},
    {DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(1.0), DSE_REAL(0.0), DSE_REAL(0.0),
     DSE_REAL(1.0), DSE_REAL(1.0), DSE_REAL(1.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0)},
    {DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(1.0), DSE_REAL(1.0), DSE_REAL(0.0),
     DSE_REAL(1.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(1.0), DSE_REAL(0.0), DSE_REAL(0.0)},
};
static const dse_real uio_D[6][3] = {
    {DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.4999999999999999)},
    {DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(-0.5000000000000001)},
    {DSE_REAL(0.0), DSE_REAL(0.4615384615384616), DSE_REAL(0.0)},
    {DSE_REAL(0.0), DSE_REAL(0.49999999999999983), DSE_REAL(0.0)},
    {DSE_REAL(0.0), DSE_REAL(0.39999999999999997), DSE_REAL(0.0)},
    {DSE_REAL(0.0), DSE_REAL(0.30769230769230754), DSE_REAL(-0.4615384615384618)},
};
static const dse_real uio_D_y[6][6] = {
    {DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(-1.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(-1.0)},
    {DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(-1.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(-1.0)},
    {DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(-1.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(-1.0)},
    {DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(-1.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(-1.0)},
    {DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(-1.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(-1.0)},
    {DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(-1.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(-1.0)},
};
static const dse_real uio_D_u[6][6] = {
    {DSE_REAL(1.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0)},
    {DSE_REAL(1.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0)},
    {DSE_REAL(1.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0)},
    {DSE_REAL(1.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0)},
    {DSE_REAL(1.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0)},
    {DSE_REAL(1.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0)},
};
static const dse_real uio_C[6][8] = {
    {DSE_REAL(1.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0),
     DSE_REAL(1.0), DSE_REAL(1.0)},
    {DSE_REAL(1.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(1.0), DSE_REAL(1.0),
     DSE_REAL(0.0), DSE_REAL(0.0)},
    {DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(1.0), DSE_REAL(0.0), DSE_REAL(1.0), DSE_REAL(0.0),
     DSE_REAL(0.0), DSE_REAL(0.0)},
    {DSE_REAL(0.0), DSE_REAL(1.0), DSE_REAL(0.0), DSE_REAL(1.0), DSE_REAL(1.0), DSE_REAL(0.0),
     DSE_REAL(0.0), DSE_REAL(0.0)},
    {DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(1.0), DSE_REAL(1.0), DSE_REAL(1.0), DSE_REAL(0.0),
     DSE_REAL(0.0), DSE_REAL(0.0)},
    {DSE_REAL(1.0), DSE_REAL(0.0), DSE_REAL(1.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(1.0),
     DSE_REAL(0.0), DSE_REAL(0.0)},
};
static const dse_real fo_Lambda[4][1] = {
    {DSE_REAL(-1.0)},
    {DSE_REAL(-1.0)},
    {DSE_REAL(-0.9999999999999996)},
    {DSE_REAL(-0.9999999999999997)},
};
static const dse_real fo_L[4][2] = {
    {DSE_REAL(0.004794246903715514), DSE_REAL(-0.004594486616060545)},
    {DSE_REAL(0.09696376101860904), DSE_REAL(-0.01958863858961879)},
    {DSE_REAL(0.06666666666666687), DSE_REAL(-0.06666666666666643)},
    {DSE_REAL(-0.06666666666666654), DSE_REAL(0.06666666666666687)},
};
static const dse_real fo_H[4][2] = {
    {DSE_REAL(-0.06871753895325612), DSE_REAL(0.0)},
    {DSE_REAL(0.7159647404505387), DSE_REAL(0.0)},
    {DSE_REAL(0.0), DSE_REAL(0.0)},
    {DSE_REAL(0.0), DSE_REAL(0.0)},
};
static const dse_real fo_N[4][2] = {
    {DSE_REAL(-0.03675589292848582), DSE_REAL(0.515980823012385)},
    {DSE_REAL(0.3095004897159652), DSE_REAL(0.28403525954946196)},
    {DSE_REAL(0.3333333333333333), DSE_REAL(0.6666666666666666)},
    {DSE_REAL(0.6666666666666666), DSE_REAL(0.3333333333333333)},
};
static const dse_real fo_J[4][2] = {
    {DSE_REAL(0.0), DSE_REAL(0.0)},
    {DSE_REAL(0.0), DSE_REAL(0.0)},
    {DSE_REAL(0.0), DSE_REAL(0.0)},
    {DSE_REAL(0.0), DSE_REAL(0.0)},
};
static const dse_real fo_z0[4][1] = {
    {DSE_REAL(39.59248901318419)},
    {DSE_REAL(-52.448579823702296)},
    {DSE_REAL(50.0)},
    {DSE_REAL(-30.0)},
};
static const dse_real fo_Pi[4][1] = {
    {DSE_REAL(0.5)},
    {DSE_REAL(0.5)},
    {DSE_REAL(0.5000000000000002)},
    {DSE_REAL(0.5000000000000002)},
};
static const dse_real fo_C2[4][1] = {
    {DSE_REAL(1.0)},
    {DSE_REAL(1.0)},
    {DSE_REAL(1.0)},
    {DSE_REAL(1.0)},
};
static const dse_real fo_D[4][1] = {
    {DSE_REAL(1.0)},
    {DSE_REAL(1.0)},
    {DSE_REAL(1.0)},
    {DSE_REAL(1.0)},
};
static const dse_real fo_D_y[4][2] = {
    {DSE_REAL(-0.03675589292848582), DSE_REAL(0.015980823012385126)},
    {DSE_REAL(0.3095004897159653), DSE_REAL(-0.7159647404505383)},
    {DSE_REAL(0.0), DSE_REAL(0.0)},
    {DSE_REAL(0.0), DSE_REAL(0.0)},
};
static const dse_real fo_D_u[4][2] = {
    {DSE_REAL(0.0), DSE_REAL(0.0)},
    {DSE_REAL(0.0), DSE_REAL(0.0)},
    {DSE_REAL(0.0), DSE_REAL(0.0)},
    {DSE_REAL(0.0), DSE_REAL(0.0)},
};
static const dse_real fo_printed_C2[4][2] = {
    {DSE_REAL(0.0), DSE_REAL(1.0)},
    {DSE_REAL(1.0), DSE_REAL(0.0)},
    {DSE_REAL(0.0), DSE_REAL(1.0)},
    {DSE_REAL(1.0), DSE_REAL(0.0)},
};
static const dse_real fo_printed_D[4][2] = {
    {DSE_REAL(0.0), DSE_REAL(1.0)},
    {DSE_REAL(1.0), DSE_REAL(0.0)},
    {DSE_REAL(0.0), DSE_REAL(1.0)},
    {DSE_REAL(1.0), DSE_REAL(0.0)},
};
static const dse_real fo_printed_D_y[4][4] = {
    {DSE_REAL(-1.0), DSE_REAL(0.0), DSE_REAL(-0.03675589292848582), DSE_REAL(-0.484019176987615)},
    {DSE_REAL(-0.6904995102840348), DSE_REAL(0.28403525954946196), DSE_REAL(0.0), DSE_REAL(-1.0)},
    {DSE_REAL(-1.0), DSE_REAL(0.0), DSE_REAL(0.3333333333333333), DSE_REAL(-0.33333333333333337)},
    {DSE_REAL(-0.33333333333333337), DSE_REAL(0.3333333333333333), DSE_REAL(0.0), DSE_REAL(-1.0)},
};
static const dse_real fo_printed_D_u[4][4] = {
    {DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0)},
    {DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0)},
    {DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0)},
    {DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0)},
};
static const dse_real fo_C[4][8] = {
    {DSE_REAL(1.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(1.0),
     DSE_REAL(1.0), DSE_REAL(0.0)},
    {DSE_REAL(1.0), DSE_REAL(0.0), DSE_REAL(1.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(1.0),
     DSE_REAL(0.0), DSE_REAL(0.0)},
    {DSE_REAL(0.0), DSE_REAL(1.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(0.0),
     DSE_REAL(1.0), DSE_REAL(0.0)},
    {DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(1.0), DSE_REAL(0.0), DSE_REAL(0.0), DSE_REAL(1.0),
     DSE_REAL(0.0), DSE_REAL(0.0)},
};

void design_uio(struct rig *rig, enum design_law law, dse_real gamma, int edges,
                const int (*edge)[2])
{
    const dse_real *C2[6];
    int rows[6];
    rig->plant = &rig_descriptor_uio;
    rig->n = 6;
    for (int i = 0; i < 6; i++) {
        rig->C[i] = uio_C[i];
        C2[i] = law == DESIGN_PRINTED ? NULL : uio_C2[i];
        rows[i] = 3;
        rig->config[i] = (struct dse_distributed_observer_config){
            .nz = 1,
            .nu = 2,
            .ny = 2,
            .nx = 4,
            .Lambda = uio_Lambda[i],
            .L = uio_L[i],
            .H = uio_H[i],
            .M = uio_M[i],
            .N = uio_N[i],
            .J = uio_J[i],
            .z0 = uio_z0[i],
            .residual = law == DESIGN_CONSISTENT ? DSE_OBSERVER_NEIGHBOURS : DSE_OBSERVER_OWN,
            .Pi = uio_Pi[i],
            .nr = 3,
            .D = uio_D[i],
            .D_y = uio_D_y[i],
            .D_u = uio_D_u[i],
            .gamma = gamma};
    }
    rig_connect(rig, edges, edge, C2, rows);
}

void design_fo(struct rig *rig, enum design_law law, dse_real gamma, int edges,
               const int (*edge)[2])
{
    const bool consistent = law == DESIGN_CONSISTENT;
    const dse_real *C2[4];
    int rows[4];
    rig->plant = &rig_descriptor_fo;
    rig->n = 4;
    for (int i = 0; i < 4; i++) {
        rig->C[i] = fo_C[i];
        C2[i] = consistent ? fo_C2[i] : fo_printed_C2[i];
        rows[i] = consistent ? 1 : 2;
        rig->config[i] = (struct dse_distributed_observer_config){
            .nz = 1,
            .nu = 2,
            .ny = 2,
            .nx = 1,
            .Lambda = fo_Lambda[i],
            .L = fo_L[i],
            .H = fo_H[i],
            .N = fo_N[i],
            .J = fo_J[i],
            .z0 = fo_z0[i],
            .residual = DSE_OBSERVER_OWN,
            .Pi = fo_Pi[i],
            .nr = rows[i],
            .D = consistent ? fo_D[i] : fo_printed_D[i],
            .D_y = consistent ? fo_D_y[i] : fo_printed_D_y[i],
            .D_u = consistent ? fo_D_u[i] : fo_printed_D_u[i],
            .gamma = gamma};
    }
    rig_connect(rig, edges, edge, C2, rows);
}
