/*
 * count - preloaded into a program under callgrind: instructions count from SIGUSR1 to SIGUSR2.
 *
 * callgrind can begin in no signal handler, so it begins where the program waits next.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <signal.h>
#include <sys/epoll.h>
#include <valgrind/callgrind.h>

static volatile sig_atomic_t wanted;
static int (*wait_really)(int, struct epoll_event *, int, int);

static void take(int signal)
{
    wanted = signal;
}

__attribute__((constructor)) static void prepare(void)
{
    wait_really = (int (*)(int, struct epoll_event *, int, int))dlsym(RTLD_NEXT, "epoll_wait");
    signal(SIGUSR1, take);
    signal(SIGUSR2, take);
}

int epoll_wait(int poll, struct epoll_event *events, int most, int timeout)
{
    if (wanted == SIGUSR1) {
        wanted = 0;
        CALLGRIND_START_INSTRUMENTATION;
    } else if (wanted == SIGUSR2) {
        wanted = 0;
        CALLGRIND_DUMP_STATS;
        CALLGRIND_STOP_INSTRUMENTATION;
    }
    return wait_really(poll, events, most, timeout);
}
