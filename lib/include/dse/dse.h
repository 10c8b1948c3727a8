/* The whole library. */
#ifndef DSE_DSE_H
#define DSE_DSE_H

#include "dse/active_set.h"
#include "dse/arena.h"
#include "dse/coordinated_mhe.h"
#include "dse/distributed_kalman.h"
#include "dse/distributed_observer.h"
#include "dse/ekf.h"
#include "dse/factored.h"
#include "dse/gramian.h"
#include "dse/graph.h"
#include "dse/health.h"
#include "dse/high_gain_ekf.h"
#include "dse/kalman.h"
#include "dse/linalg.h"
#include "dse/linear_mhe.h"
#include "dse/link.h"
#include "dse/math.h"
#include "dse/model.h"
#include "dse/normal_form.h"
#include "dse/ode.h"
#include "dse/part.h"
#include "dse/plant.h"
#include "dse/quadratic.h"
#include "dse/random.h"
#include "dse/real.h"
#include "dse/status.h"
#include "dse/window_qp.h"
#include "dse/wire.h"

#endif
