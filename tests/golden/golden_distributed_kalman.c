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
    int worst = GOLDEN_PASS;
    for (int k = 1; k < argc; k++) {
        json_error_t error;
        json_t *root = json_load_file(argv[k], 0, &error);
        printf("%s\n", argv[k]);
        const int result = root != NULL ? file_of_any_kind(root) : GOLDEN_FAIL;
        if (root == NULL)
            printf("  line %d: %s\n", error.line, error.text);
        json_decref(root);
        worst = result == GOLDEN_FAIL || worst == GOLDEN_PASS ? result : worst;
    }
    return argc > 1 ? worst : GOLDEN_FAIL;
}
