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
    return golden_main(argc, argv, file_of_any_kind);
}
