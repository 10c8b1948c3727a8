/* plant.drive of a scenario as the simulator takes it. */
#ifndef DSE_RUNTIME_PLANT_DRIVE_H
#define DSE_RUNTIME_PLANT_DRIVE_H

#include "runtime/scenario.h"
#include "sim/drive.h"

struct plant_drives {
    struct sim_drive *drives;      /* scenario->plant.drive_count */
    struct sim_loop *loops;        /* as many; of those inputs that have one */
    struct sim_signal_step *steps; /* of all inputs, one after the other */
    unsigned count;
};

/* The scenario must have been judged. False when out of memory; then there is nothing to free. */
bool plant_drives_make(const struct scenario *scenario, struct plant_drives *drives);
void plant_drives_free(struct plant_drives *drives);

#endif
