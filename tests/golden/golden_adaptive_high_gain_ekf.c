/* golden_adaptive_high_gain_ekf FILE.json ...
 *
 * Compares plants, gain adaptation and whole filter runs with reference data of the adaptive
 * high-gain EKF. The kind of a file is recognised by its keys. Exit code 0: all within their
 * tolerance; 1: some are not, or a file cannot be read; 2: a file asks for a plant or a mode that
 * is not supported. */
#include <stdio.h>

#include "adaptive_high_gain_ekf/parts.h"

static int check_file(const json_t *root)
{
    int result = GOLDEN_UNSUPPORTED;
    if (json_object_get(root, "cases") != NULL) {
        result = golden_gain_file(root);
    } else if (json_object_get(root, "points") != NULL &&
               json_object_get(root, "n_reactors") != NULL) {
        result = golden_plant_file(root);
    } else if (json_object_get(root, "surrogate_plant_ad2") != NULL) {
        result = golden_three_tank_plant_file(root);
    } else if (json_object_get(root, "r_true") != NULL) {
        result = golden_three_tank_run_file(root);
    } else if (json_is_object(json_object_get(root, "config")) &&
               json_object_get(root, "record") != NULL) {
        result = golden_run_file(root);
    }
    return result;
}

int main(int argc, char **argv)
{
    return golden_main(argc, argv, check_file);
}
