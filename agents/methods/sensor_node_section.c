/* The schema of what the sections of nodes on a graph of sensors have in common. */
#include "methods/sensor_node.h"

const cyaml_schema_value_t sensor_node_number = {CYAML_VALUE_FLOAT(CYAML_FLAG_DEFAULT, double)};
const cyaml_schema_value_t sensor_node_whole = {CYAML_VALUE_UINT(CYAML_FLAG_DEFAULT, unsigned)};
