/* golden_consensus_linear FILE.json ...
 *
 * Compares consensus filters, average consensus and linear consensus Kalman filters (types I and
 * II, literal and safe forms), the information and the micro-Kalman filter, a Luenberger observer
 * and the observability Gramian with reference data. Exit code 0: all within their tolerance; 1:
 * some are not, or a file cannot be read; 2: not supported. */
#include <stdio.h>

#include "consensus_linear/parts.h"

static int file_of_any_kind(const json_t *root)
{
    if (json_object_get(root, "linear_protocol") != NULL)
        return golden_consensus_filters(root);
    if (json_object_get(root, "homogeneous") != NULL)
        return golden_consensus_kalman(root);
    printf("  neither filters nor networks\n");
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
