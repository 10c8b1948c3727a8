/* golden_distributed_kalman FILE.json ...
 *
 * Compares networks of distributed Kalman filters with reference runs: continuous ones over a
 * time-varying plant in all schemes, with offline gains, and as Luenberger observers; discrete
 * ones. Exit code 0: all within their tolerance; 1: some are not, or a file cannot be read; 2: not
 * supported. */
#include <stdio.h>

#include "distributed_kalman/parts.h"

static int file_of_any_kind(const json_t *root)
{
    if (json_object_get(root, "A_list") != NULL)
        return golden_discrete_network(root);
    if (json_object_get(root, "design") != NULL)
        return golden_offline_network(root);
    if (json_object_get(root, "L") != NULL)
        return golden_luenberger_network(root);
    if (json_object_get(root, "runs") != NULL)
        return golden_adaptive_networks(root);
    printf("  not a run of a network\n");
    return GOLDEN_UNSUPPORTED;
}

int main(int argc, char **argv)
{
    return golden_main(argc, argv, file_of_any_kind);
}
