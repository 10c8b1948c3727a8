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
