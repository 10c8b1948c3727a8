/* Send-on-delta. */
#include <stddef.h>

#include "dse/link.h"
#include "dse/math.h"

enum dse_status dse_trigger_init(struct dse_trigger *trigger,
                                 const struct dse_trigger_config *config, int n,
                                 struct dse_arena *arena)
{
    if (trigger == NULL || config == NULL || arena == NULL || n < 1 ||
        (unsigned)config->norm > DSE_TRIGGER_RELATIVE || !(config->threshold >= 0) ||
        !dse_is_finite(config->threshold)) {
        return DSE_EINVAL;
    }
    for (int k = 0; config->weights != NULL && k < n; k++) {
        if (!(config->weights[k] >= 0) || !dse_is_finite(config->weights[k])) {
            return DSE_EINVAL;
        }
    }
    *trigger = (struct dse_trigger){.config = config, .n = n};
    trigger->last = dse_arena_take(arena, n);
    return trigger->last != NULL ? DSE_OK : DSE_ESTORAGE;
}

bool dse_trigger_fires(const struct dse_trigger *trigger, const dse_real *value)
{
    const struct dse_trigger_config *config = trigger->config;
    dse_real sum = 0;
    if (!trigger->sent) {
        return true;
    }
    for (int k = 0; k < trigger->n; k++) {
        const dse_real last = trigger->last[k];
        dse_real move = value[k] - last;
        /* 0/0 is no move */
        if (config->norm == DSE_TRIGGER_RELATIVE && !(value[k] <= last && value[k] >= last)) {
            move /= last;
        }
        if (config->weights != NULL) {
            move *= config->weights[k];
        }
        sum += move * move;
    }
    /* |H ..| >= L; what is not a number is sent */
    return !(dse_sqrt(sum) < config->threshold);
}

void dse_trigger_sent(struct dse_trigger *trigger, const dse_real *value)
{
    for (int k = 0; k < trigger->n; k++) {
        trigger->last[k] = value[k];
    }
    trigger->sent = true;
}
