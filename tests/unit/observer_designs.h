/* Networks of observers of the two descriptor plants, configured in a rig and ready to start. */
#ifndef OBSERVER_DESIGNS_H
#define OBSERVER_DESIGNS_H

#include "observer_rig.h"

enum design_law {
    DESIGN_CONSISTENT, /* UIO9, FO8 */
    DESIGN_PRINTED,    /* UIO1, FO1 */
    DESIGN_PROJECTED   /* UIO2; as PRINTED for functional observers */
};

/* Six nodes of section 5.2, initial states as published. Directed edges (from, to). */
void design_uio(struct rig *rig, enum design_law law, dse_real gamma, int edges,
                const int (*edge)[2]);
/* Four nodes of section 5.3 with initial errors 40, -60, 50, -30. */
void design_fo(struct rig *rig, enum design_law law, dse_real gamma, int edges,
               const int (*edge)[2]);

#endif
