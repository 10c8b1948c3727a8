/* Keys of a network that an experiment asks for. */
#include "methods/lossy_link.h"

const cyaml_schema_field_t lossy_link_fields[] = {
    CYAML_FIELD_UINT("D", CYAML_FLAG_DEFAULT, struct lossy_link_section, D),
    CYAML_FIELD_UINT("T_m", CYAML_FLAG_OPTIONAL, struct lossy_link_section, T_m),
    CYAML_FIELD_FLOAT("loss", CYAML_FLAG_OPTIONAL, struct lossy_link_section, loss),
    CYAML_FIELD_UINT("seed", CYAML_FLAG_OPTIONAL, struct lossy_link_section, seed),
    CYAML_FIELD_STRING_PTR("file", CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL,
                           struct lossy_link_section, file, 1, 500),
    CYAML_FIELD_END};
