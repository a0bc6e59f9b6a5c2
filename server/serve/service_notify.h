/* service_notify.h: reports the program's state to its service manager, by the protocol of sd_notify(3).
 * Threads: [any].
 *
 * A datagram to the socket that $NOTIFY_SOCKET names is all there is to it: no library is needed for that. */
#ifndef LW_SERVE_SERVICE_NOTIFY_H
#define LW_SERVE_SERVICE_NOTIFY_H

#include "common/base/status.h"

/** Sends assignments, apart by newlines, such as "READY=1". Never waits: what the manager has no room for is
 * lost. Returns whether it was sent; false, too, where no manager asked. */
bool lw_service_notify(const char *format, ...) LW_PRINTF(1, 2);

/** Whether a manager asked. */
bool lw_service_notify_wanted(void);

/** Interval of "WATCHDOG=1", in milliseconds: a third of $WATCHDOG_USEC. 0: nobody waits for it. */
unsigned lw_service_notify_watchdog_ms(void);

#endif
