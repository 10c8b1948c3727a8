/* golden_second_order FILE.json ...
 *
 * Compares second-order filters for quadratic systems, alone and in networks of all schemes, with
 * reference runs, and the quadratic plants with reference points and trajectories. Exit code 0: all
 * within their tolerance; 1: some are not, or a file cannot be read; 2: not supported. */
#include <stdio.h>

#include "second_order/parts.h"

static int file_of_any_kind(const json_t *root)
{
    if (json_object_get(root, "plant") != NULL)
        return golden_quadratic_plant(root);
    if (json_object_get(root, "cases") != NULL)
        return golden_second_order_network(root);
    printf("  neither a plant nor runs of a network\n");
    return GOLDEN_UNSUPPORTED;
}

int main(int argc, char **argv)
{
    return golden_main(argc, argv, file_of_any_kind);
}
