/* Channel names: see lcmtypes/README.md. */
#ifndef DSE_RUNTIME_CHANNELS_H
#define DSE_RUNTIME_CHANNELS_H

#define CHANNEL_CLOCK       "DSE_CLOCK"
#define CHANNEL_STATUS      "DSE_STATUS"
#define CHANNEL_RUN_INFO    "DSE_RUN_INFO"
#define CHANNEL_INPUT       "DSE_INPUT"
#define CHANNEL_TRUTH       "DSE_TRUTH"
#define CHANNEL_DONE        "DSE_DONE"
#define CHANNEL_MEASUREMENT "DSE_MEASUREMENT_%d" /* sensor group */
#define CHANNEL_EXCHANGE    "DSE_EXCHANGE_%d_%d" /* network, node */
#define CHANNEL_ESTIMATE    "DSE_ESTIMATE_%d_%d" /* network, node */

/* Room for any of them. */
#define CHANNEL_LENGTH 48

#endif
