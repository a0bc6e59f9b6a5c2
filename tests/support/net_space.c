#include "tests/support/net_space.h"

#include "tests/support/support.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

static bool runs_well(const char *format, ...) __attribute__((format(printf, 1, 2)));
static bool runs_well(const char *format, ...) {
    char command[300];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(command, sizeof command, format, arguments);
    va_end(arguments);
    return system(command) == 0;
}

/* Numbers in 10.213.0.0/16, four addresses for each cable. */
static void choose_names(struct lw_net_space *space, unsigned cable_count) {
    const int process = (int)getpid();
    snprintf(space->name, sizeof space->name, "lw_test_%d", process);
    space->cable_count = cable_count;
    for (unsigned i = 0; i < cable_count; i++) {
        struct lw_net_space_cable *cable = &space->cable[i];
        const unsigned n = ((unsigned)process * LW_NET_SPACE_CABLES + i) % 16384;
        snprintf(cable->near_end, sizeof cable->near_end, "lw%c%d", 'a' + (int)(2 * i), process);
        snprintf(cable->far_end, sizeof cable->far_end, "lw%c%d", 'b' + (int)(2 * i), process);
        snprintf(cable->here, sizeof cable->here, "10.213.%u.%u", n / 64, n % 64 * 4 + 1);
        snprintf(cable->there, sizeof cable->there, "10.213.%u.%u", n / 64, n % 64 * 4 + 2);
    }
}

static bool lay(const struct lw_net_space *space, const struct lw_net_space_cable *cable) {
    return runs_well("ip link add %s type veth peer name %s netns %s 2>/dev/null", cable->near_end,
                     cable->far_end, space->name) &&
           runs_well("ip addr add %s/30 dev %s && ip link set %s up", cable->here, cable->near_end,
                     cable->near_end) &&
           runs_well("ip -n %s addr add %s/30 dev %s && ip -n %s link set %s up", space->name, cable->there,
                     cable->far_end, space->name, cable->far_end);
}

bool lw_net_space_make(struct lw_net_space *space, unsigned cable_count) {
    assert_true(cable_count <= LW_NET_SPACE_CABLES);
    choose_names(space, cable_count);
    bool done = geteuid() == 0 && runs_well("ip netns add %s 2>/dev/null", space->name);
    for (unsigned i = 0; done && i < cable_count; i++) done = lay(space, &space->cable[i]);
    if (!done) print_message("skipped: needs root, ip(8) and network namespaces\n");
    return done;
}

void lw_net_space_plug(const struct lw_net_space *space, unsigned cable, bool in) {
    assert_true(cable < space->cable_count);
    assert_true(
        runs_well("ip -n %s link set %s %s", space->name, space->cable[cable].far_end, in ? "up" : "down"));
}

void lw_net_space_remove(struct lw_net_space *space) {
    if (!*space->name || geteuid() != 0) return;
    (void)runs_well("ip netns del %s 2>/dev/null", space->name);
    for (unsigned i = 0; i < space->cable_count; i++)
        (void)runs_well("ip link del %s 2>/dev/null", space->cable[i].near_end);
    *space = (struct lw_net_space){.cable_count = 0};
}
