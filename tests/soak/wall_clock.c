/* The wall clock of a process, so many seconds off as the file $WALL_CLOCK_OFF says. Other clocks are left alone. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <time.h>

static volatile long *off;

__attribute__((constructor)) static void find(void)
{
    const char *name = getenv("WALL_CLOCK_OFF");
    int file = name ? open(name, O_RDONLY) : -1;
    void *there = file < 0 ? MAP_FAILED : mmap(NULL, sizeof *off, PROT_READ, MAP_SHARED, file, 0);
    off = there == MAP_FAILED ? NULL : there;
}

int clock_gettime(clockid_t clock, struct timespec *now)
{
    static int (*real)(clockid_t, struct timespec *);
    if (!real)
        real = (int (*)(clockid_t, struct timespec *))dlsym(RTLD_NEXT, "clock_gettime");
    int result = real(clock, now);
    if (!result && off && clock == CLOCK_REALTIME)
        now->tv_sec += *off;
    return result;
}
