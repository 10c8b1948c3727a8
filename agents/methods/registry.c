/* The methods that scenarios can name: one line each. */
#include <stddef.h>
#include <string.h>

#include "methods/method.h"

extern const struct method consensus_kalman_method;
extern const struct method coordinated_mhe_method;
extern const struct method distributed_kalman_method;
extern const struct method distributed_observer_method;
extern const struct method high_gain_ekf_method;
extern const struct method second_order_method;

static const struct method *const methods[] = {
    &high_gain_ekf_method,        &coordinated_mhe_method,  &distributed_kalman_method,
    &distributed_observer_method, &consensus_kalman_method, &second_order_method,
};

const struct method *method_at(int i)
{
    int count = (int)(sizeof methods / sizeof methods[0]);
    return i >= 0 && i < count ? methods[i] : NULL;
}

const struct method *method_find(const char *name)
{
    for (int i = 0; method_at(i) != NULL; i++)
        if (strcmp(method_at(i)->name, name) == 0)
            return method_at(i);
    return NULL;
}
