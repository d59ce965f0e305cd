/*
 * count - preloaded into a gateway under callgrind: instructions count from SIGUSR1 to SIGUSR2.
 *
 * callgrind can begin in no signal handler, so it begins where the program waits next.
 *
 * The tool makes the gateway fifty times as slow as it is, and whatever else the machine does slower still. Neither is
 * to decide what is counted. So with COUNT_STEP, while it counts:
 *
 * - A wait begins once nothing more comes: those of COUNT_BESIDE, clients and devices, sleep, and what waits to be read
 *   does not change. So the gateway always finds what a quick one would find.
 * - What was opened last is found first: clients before lines. So nobody can be quicker than the gateway is slow, and
 *   have asked again by the time it comes to him.
 * - Its clock goes on by COUNT_STEP nanoseconds at each wait, and by what it waits in vain.
 *
 * This itself does not count.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <poll.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/ioctl.h>
#include <sys/select.h>
#include <time.h>
#include <valgrind/callgrind.h>

/* So many looks in a row find the same, with pauses of so many nanoseconds between. */
#define LOOKS 3
#define PAUSE 300000
#define MOST 64
/* The number of the call on every machine. */
#define EPOLL_PWAIT2 441

static volatile sig_atomic_t wanted;
static int (*wait_really)(int, struct epoll_event *, int, int);
static int (*select_really)(int, fd_set *, fd_set *, fd_set *, struct timeval *);
static int (*time_really)(clockid_t, struct timespec *);
static long (*call_really)(long, ...);
static const char *beside;
static long long step, now; /* now: nanoseconds of the gateway's clock, 0 unless it is this one */

static void take(int signal)
{
    wanted = signal;
}

__attribute__((constructor)) static void prepare(void)
{
    wait_really = (int (*)(int, struct epoll_event *, int, int))dlsym(RTLD_NEXT, "epoll_wait");
    select_really = (int (*)(int, fd_set *, fd_set *, fd_set *, struct timeval *))dlsym(RTLD_NEXT, "select");
    time_really = (int (*)(clockid_t, struct timespec *))dlsym(RTLD_NEXT, "clock_gettime");
    call_really = (long (*)(long, ...))dlsym(RTLD_NEXT, "syscall");
    beside = getenv("COUNT_BESIDE") ? getenv("COUNT_BESIDE") : "";
    step = getenv("COUNT_STEP") ? atoll(getenv("COUNT_STEP")) : 0;
    signal(SIGUSR1, take);
    signal(SIGUSR2, take);
}

/* For a program that loads this itself, and knows what is to count (growth.py). */
void begin_counting(void)
{
    CALLGRIND_START_INSTRUMENTATION;
}

void end_counting(void)
{
    CALLGRIND_DUMP_STATS;
    CALLGRIND_STOP_INSTRUMENTATION;
}

static int sleeps(long process)
{
    char name[64], text[512] = "";
    snprintf(name, sizeof name, "/proc/%ld/stat", process);
    FILE *file = fopen(name, "r");
    if (!file)
        return 1; /* it has ended */
    size_t size = fread(text, 1, sizeof text - 1, file);
    fclose(file);
    text[size] = 0;
    const char *state = strrchr(text, ')');
    return !state || state[2] == 'S';
}

static int others_sleep(void)
{
    char *rest;
    for (const char *at = beside; *at; at = *rest ? rest + 1 : rest)
        if (!sleeps(strtol(at, &rest, 10)))
            return 0;
    return 1;
}

/* What waits to be read, and where. */
static long waiting(int poll)
{
    struct epoll_event ready[MOST];
    int count = wait_really(poll, ready, MOST, 0);
    long sum = count;
    for (int i = 0; i < count; i++) {
        int bytes = 0;
        ioctl(ready[i].data.fd, FIONREAD, &bytes);
        sum += 1000L * (ready[i].data.fd + 1) + bytes;
    }
    return sum;
}

static void settle(int poll)
{
    const struct timespec pause = {0, PAUSE};
    long before = -1;
    for (int same = 0; same < LOOKS; ) {
        long found = waiting(poll);
        same = found == before && others_sleep() ? same + 1 : 0;
        before = found;
        nanosleep(&pause, NULL);
    }
}

static int newer(const void *one, const void *other)
{
    return ((const struct epoll_event *)other)->data.fd - ((const struct epoll_event *)one)->data.fd;
}

/* Before a wait: begin or end to count, if that is wanted, and see that nothing more comes. */
static void before_wait(int poll)
{
    if (wanted == SIGUSR1) {
        wanted = 0;
        if (step) {
            struct timespec time;
            time_really(CLOCK_MONOTONIC, &time);
            now = time.tv_sec * 1000000000LL + time.tv_nsec;
        }
        CALLGRIND_START_INSTRUMENTATION;
    } else if (wanted == SIGUSR2) {
        wanted = 0;
        CALLGRIND_DUMP_STATS;
        CALLGRIND_STOP_INSTRUMENTATION;
    }
    if (now) {
        CALLGRIND_TOGGLE_COLLECT;
        settle(poll);
        now += step;
        CALLGRIND_TOGGLE_COLLECT;
    }
}

/* After a wait of at most so many nanoseconds. */
static void after_wait(struct epoll_event *events, int count, long long timeout)
{
    if (now) {
        CALLGRIND_TOGGLE_COLLECT;
        if (count > 1)
            qsort(events, (size_t)count, sizeof *events, newer);
        if (count == 0 && timeout > 0)
            now += timeout;
        CALLGRIND_TOGGLE_COLLECT;
    }
}

int epoll_wait(int poll, struct epoll_event *events, int most, int timeout)
{
    before_wait(poll);
    int count = wait_really(poll, events, most, timeout);
    after_wait(events, count, timeout * 1000000LL);
    return count;
}

/* `epoll_pwait2`, which valgrind does not know, and whatever else is called by its number. */
long syscall(long number, ...)
{
    long a[6];
    va_list arguments;
    va_start(arguments, number);
    for (int i = 0; i < 6; i++)
        a[i] = va_arg(arguments, long);
    va_end(arguments);
    if (number != EPOLL_PWAIT2 || !RUNNING_ON_VALGRIND)
        return call_really(number, a[0], a[1], a[2], a[3], a[4], a[5]);
    int poll = (int)a[0];
    struct epoll_event *events = (struct epoll_event *)a[1];
    const struct timespec *timeout = (const struct timespec *)a[3];
    before_wait(poll);
    struct pollfd own = {poll, POLLIN, 0};
    int count = ppoll(&own, 1, timeout, NULL);
    if (count > 0)
        count = wait_really(poll, events, (int)a[2], 0);
    after_wait(events, count, timeout->tv_sec * 1000000000LL + timeout->tv_nsec);
    return count;
}

int select(int most, fd_set *reading, fd_set *writing, fd_set *failing, struct timeval *timeout)
{
    long long wait = timeout ? timeout->tv_sec * 1000000000LL + timeout->tv_usec * 1000LL : 0;
    if (now) {
        CALLGRIND_TOGGLE_COLLECT;
        for (int poll = 0; poll < most; poll++)
            if (FD_ISSET(poll, reading))
                settle(poll);
        CALLGRIND_TOGGLE_COLLECT;
    }
    int count = select_really(most, reading, writing, failing, timeout);
    if (now && count == 0)
        now += wait;
    return count;
}

int clock_gettime(clockid_t clock, struct timespec *time)
{
    if (!now || clock != CLOCK_MONOTONIC)
        return time_really(clock, time);
    time->tv_sec = now / 1000000000LL;
    time->tv_nsec = now % 1000000000LL;
    return 0;
}
