/*
 * load - Modbus load generator: connections of Modbus TCP, UDP or RTU over TCP,
 * or one RTU client per serial device (the "no gateway" reference).
 *
 *   load --target 127.0.0.1:5020=1-10 [--target ...] --conns 16 [options]
 *   load --target rtu:tty0=1-10 --conns 1 [options]
 *
 *   --target T      the k-th target is line k; =1-10 are its units on the wire.
 *                   udp:HOST:PORT and rtu+tcp:HOST:PORT speak something else
 *   --one-listener  all lines share a listener: unit u of line k is asked for as
 *                   N * k + u
 *   --line-step N   that N (default and most: 20); must stand before the targets
 *   --conns K       active connections, spread round-robin over the targets
 *   --pipeline P    requests outstanding per connection (default 1)
 *   --idle M        further connections that are opened and never used
 *   --fc F          function 1..4 (default 3)
 *   --count N       registers or bits per request (default 10)
 *   --warmup S      seconds before the measurement (default 0.5)
 *   --seconds S     measured seconds (default 3)
 *   --timeout S     a request older than this is an error (default 5); the
 *                   connection is then closed and opened again. At the end as
 *                   long is waited for what is still outstanding.
 *   --watch PID     add this process's CPU time and memory to the report
 *                   (may be repeated)
 *   --span N        addresses used are 0..N-1 (default 1000; 1 = always address 0)
 *   --think MS      pause between a reply and the connection's next request
 *   --random        that pause is random, 0..MS
 *   --exc-think MS  pause after an exception response (default: that of --think)
 *   --sticky        every connection keeps to one unit of its target's list
 *   --fresh         a device stamps its answers (devices --stamp): an answer of
 *                   a transaction that began before its request was sent is stale
 *
 * Every reply is checked: transaction id (any order), protocol id, length,
 * unit, function and data.  One JSON line goes to stdout: `rate` is good answers
 * per measured second, `pace` the same between the first and the last of them
 * (no rounding to whole answers); ok_by and exceptions_by count by unit, known
 * as N * line + unit.  What goes wrong counts from the first request to the
 * last answer, also outside the measured time.
 */
#define _GNU_SOURCE
#include "wire.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <netinet/tcp.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/timerfd.h>
#include <termios.h>
#include <unistd.h>

#define MAX_TARGETS 64
#define MAX_CONNS 2048
#define MAX_PIPE 64
#define MAX_SAMPLES (8u << 20)
#define MAX_KNOWN (MAX_TARGETS * WIRE_MAX_LINE_STEP + 256)

struct target {
    char host[128];
    int port, rtu, udp;           /* port: 0 for a serial device */
    unsigned line;                /* added to a unit: what it is known as */
    uint8_t units[256];
    int n_units;
};

struct slot {
    int used;
    uint16_t tid, addr;
    uint8_t unit;                 /* as asked for */
    unsigned known;               /* line and unit: pattern of its values */
    int64_t t0, due;              /* due: when to send after --think */
};

struct conn {
    int fd;
    struct target *t;
    int next_unit;
    uint16_t tid;
    struct slot s[MAX_PIPE];
    uint8_t in[2048];
    size_t n_in;
};

static struct target targets[MAX_TARGETS];
static struct conn conns[MAX_CONNS];
static int n_targets, n_conns = 1, pipeline_n = 1, fc = 3, count = 10, sticky, span = 1000;
static int n_idle, ep, one_listener, fresh, random_think;
static double warmup = 0.5, seconds = 3, timeout_s = 5, think_ms, exc_think_ms;
static int watch[128], n_watch;
static float *lat;
static unsigned long ok, n_exc[256], n_timeout, n_bad_tid, n_bad_unit, n_bad_data,
    n_bad_frame, n_closed, n_sent, n_stale, ok_by[MAX_KNOWN], exc_by[MAX_KNOWN];
static int64_t first_ok, last_ok;
static size_t n_lat;
static int idle_fd[MAX_CONNS], idle_ok, conn_fail;
static int measuring, running = 1;

static void die(const char *m) { perror(m); exit(1); }

static void parse_target(const char *v)
{
    struct target *t = &targets[n_targets];
    t->line = (unsigned)n_targets++ * wire_line_step;
    char buf[300];
    snprintf(buf, sizeof buf, "%s", v);
    char *eq = strrchr(buf, '=');
    const char *u = "1";
    if (eq) { *eq = 0; u = eq + 1; }
    char *host = buf, *c = strrchr(buf, ':');
    if (!c) { fprintf(stderr, "bad target %s\n", v); exit(2); }
    t->rtu = !strncmp(buf, "rtu", 3);
    t->udp = !strncmp(buf, "udp:", 4);
    if (t->rtu || t->udp)
        host = strchr(buf, ':') + 1;
    if (host <= c) {
        *c = 0;
        t->port = atoi(c + 1);
    }
    snprintf(t->host, sizeof t->host, "%.120s", host);
    while (*u) {
        char *e;
        long a = strtol(u, &e, 10), b = a;
        if (*e == '-')
            b = strtol(e + 1, &e, 10);
        for (; a <= b && t->n_units < 255; a++)
            t->units[t->n_units++] = (uint8_t)a;
        u = *e == ',' ? e + 1 : e;
        if (*e && *e != ',')
            break;
    }
}

static int net_open(struct target *t)
{
    struct sockaddr_in a = { .sin_family = AF_INET, .sin_port = htons((uint16_t)t->port) };
    int one = 1, fd = socket(AF_INET, (t->udp ? SOCK_DGRAM : SOCK_STREAM) | SOCK_CLOEXEC, 0);
    inet_pton(AF_INET, t->host, &a.sin_addr);
    if (fd < 0 || connect(fd, (struct sockaddr *)&a, sizeof a)) {
        if (fd >= 0)
            close(fd);
        return -1;
    }
    setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &one, sizeof one);
    fcntl(fd, F_SETFL, O_NONBLOCK);
    return fd;
}

static int tty_open(struct target *t)
{
    struct termios o;
    int fd = open(t->host, O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
    if (fd < 0)
        return -1;
    tcgetattr(fd, &o);
    cfmakeraw(&o);
    tcsetattr(fd, TCSANOW, &o);
    return fd;
}

static int conn_open(struct conn *c)
{
    c->fd = c->t->port ? net_open(c->t) : tty_open(c->t);
    c->n_in = 0;
    memset(c->s, 0, sizeof c->s);
    if (c->fd < 0)
        return -1;
    struct epoll_event e = { .events = EPOLLIN, .data.ptr = c };
    epoll_ctl(ep, EPOLL_CTL_ADD, c->fd, &e);
    return 0;
}

static void send_one(struct conn *c, struct slot *s)
{
    uint8_t b[16];
    size_t n;
    s->used = 1;
    s->tid = ++c->tid;
    s->known = c->t->units[c->next_unit] + c->t->line;
    s->unit = one_listener ? (uint8_t)s->known : c->t->units[c->next_unit];
    if (!sticky)
        c->next_unit = (c->next_unit + 1) % c->t->n_units;
    s->addr = (uint16_t)((s->tid * 7u) % (unsigned)span);
    uint8_t pdu[5] = { (uint8_t)fc, (uint8_t)(s->addr >> 8), (uint8_t)s->addr,
                       (uint8_t)(count >> 8), (uint8_t)count };
    if (c->t->rtu) {
        b[0] = s->unit;
        memcpy(b + 1, pdu, 5);
        uint16_t crc = wire_crc(b, 6);
        b[6] = (uint8_t)crc;
        b[7] = (uint8_t)(crc >> 8);
        n = 8;
    } else {
        b[0] = (uint8_t)(s->tid >> 8);
        b[1] = (uint8_t)s->tid;
        b[2] = b[3] = b[4] = 0;
        b[5] = 6;
        b[6] = s->unit;
        memcpy(b + 7, pdu, 5);
        n = 12;
    }
    s->t0 = wire_now();
    n_sent++;
    if (write(c->fd, b, n) != (ssize_t)n)
        n_bad_frame++;
}

static void send_next(struct conn *c, struct slot *s, double pause_ms)
{
    if (!running)
        return;
    if (random_think)
        pause_ms *= drand48();
    if (pause_ms > 0)
        s->due = wire_now() + (int64_t)(pause_ms * 1e6);
    else
        send_one(c, s);
}

static void conn_reset(struct conn *c)
{
    if (c->fd >= 0)
        close(c->fd);
    for (int k = 0; k < 50; k++) {
        if (!conn_open(c))
            break;
        usleep(20000);
    }
    if (c->fd >= 0 && running)
        for (int i = 0; i < pipeline_n; i++)
            send_one(c, &c->s[i]);
}

static int data_fits(const struct slot *s, const uint8_t *data)
{
    for (int i = fresh ? WIRE_STAMP_REGS : 0; i < count; i++) {
        unsigned a = (unsigned)s->addr + (unsigned)i;
        if (fc >= 3) {
            if (((unsigned)data[2 * i] << 8 | data[2 * i + 1]) != wire_reg(s->known, a))
                return 0;
        } else if (((data[i / 8] >> (i % 8)) & 1) != wire_bit(s->known, a)) {
            return 0;
        }
    }
    return 1;
}

static int64_t stamp_of(const uint8_t *data)
{
    uint64_t t = 0;
    for (int i = 0; i < 2 * WIRE_STAMP_REGS; i++)
        t = t << 8 | data[i];
    return (int64_t)t;
}

/* pdu: function code on; n its length.  Returns the pause before the next request. */
static double check(struct slot *s, unsigned unit, const uint8_t *pdu, size_t n)
{
    int64_t now = wire_now();
    size_t want = fc <= 2 ? (size_t)(count + 7) / 8 : (size_t)count * 2;
    if (unit != s->unit) {
        n_bad_unit++;
    } else if (pdu[0] == (fc | 0x80) && n == 2) {
        n_exc[pdu[1]]++;
        exc_by[s->known]++;
        return exc_think_ms > 0 ? exc_think_ms : think_ms;
    } else if (pdu[0] != fc || n != want + 2 || pdu[1] != want) {
        n_bad_frame++;
    } else if (!data_fits(s, pdu + 2)) {
        n_bad_data++;
    } else if (fresh && stamp_of(pdu + 2) < s->t0) {
        n_stale++;
    } else if (measuring) {
        ok++;
        ok_by[s->known]++;
        if (!first_ok)
            first_ok = now;
        last_ok = now;
        if (n_lat < MAX_SAMPLES)
            lat[n_lat++] = (float)((now - s->t0) / 1e3);
    }
    return think_ms;
}

static void on_tcp(struct conn *c)
{
    size_t pos = 0;
    while (c->n_in - pos >= 8) {
        const uint8_t *p = c->in + pos;
        size_t len = (size_t)p[4] << 8 | p[5];
        if (p[2] || p[3] || len < 3 || len > 254) {
            n_bad_frame++;
            conn_reset(c);
            return;
        }
        if (c->n_in - pos < 6 + len)
            break;
        uint16_t tid = (uint16_t)(p[0] << 8 | p[1]);
        struct slot *s = NULL;
        for (int i = 0; i < pipeline_n; i++)
            if (c->s[i].used && c->s[i].tid == tid)
                s = &c->s[i];
        if (!s) {
            n_bad_tid++;
        } else {
            double pause = check(s, p[6], p + 7, len - 1);
            s->used = 0;
            send_next(c, s, pause);
        }
        pos += 6 + len;
    }
    memmove(c->in, c->in + pos, c->n_in - pos);
    c->n_in -= pos;
}

static void on_rtu(struct conn *c)
{
    struct slot *s = &c->s[0];
    size_t want = 5;
    double pause = think_ms;
    if (c->n_in >= 2 && !(c->in[1] & 0x80))
        want = 5 + (fc <= 2 ? (size_t)(count + 7) / 8 : (size_t)count * 2);
    if (c->n_in < want)
        return;
    if (wire_crc(c->in, want - 2) != (uint16_t)(c->in[want - 2] | c->in[want - 1] << 8))
        n_bad_frame++;
    else
        pause = check(s, c->in[0], c->in + 1, want - 3);
    c->n_in = 0;
    s->used = 0;
    send_next(c, s, pause);
}

static double cpu_of(int pid)
{
    clockid_t id;
    struct timespec t;
    if (clock_getcpuclockid(pid, &id) || clock_gettime(id, &t))
        return -1;
    return (double)t.tv_sec + t.tv_nsec / 1e9;
}

static void status_of(int pid, long *rss_kb, long *csw)
{
    char path[64], line[256];
    snprintf(path, sizeof path, "/proc/%d/status", pid);
    FILE *f = fopen(path, "r");
    long v;
    while (f && fgets(line, sizeof line, f)) {
        if (sscanf(line, "VmRSS: %ld", &v) == 1)
            *rss_kb += v;
        if (sscanf(line, "voluntary_ctxt_switches: %ld", &v) == 1 ||
            sscanf(line, "nonvoluntary_ctxt_switches: %ld", &v) == 1)
            *csw += v;
    }
    if (f)
        fclose(f);
}

/* {"3":17,...} of the entries that are not 0 */
static void print_by(const char *key, const unsigned long *by)
{
    const char *sep = "";
    printf("\"%s\":{", key);
    for (int i = 0; i < MAX_KNOWN; i++)
        if (by[i]) {
            printf("%s\"%d\":%lu", sep, i, by[i]);
            sep = ",";
        }
    printf("},");
}

static int cmpf(const void *a, const void *b)
{
    float x = *(const float *)a, y = *(const float *)b;
    return x < y ? -1 : x > y;
}

/* What was read at one end of the measured time. */
struct snapshot {
    int64_t at;
    double cpu, self;             /* of the watched processes; of this one */
    long rss_kb, csw;
};

static struct snapshot take(void)
{
    struct snapshot s = { .self = cpu_of(getpid()), .at = wire_now() };
    for (int i = 0; i < n_watch; i++) {
        s.cpu += cpu_of(watch[i]);
        status_of(watch[i], &s.rss_kb, &s.csw);
    }
    return s;
}

static int idle_closed(void)
{
    int n = 0;
    char c;
    for (int i = 0; i < n_idle; i++)
        n += idle_fd[i] >= 0 && recv(idle_fd[i], &c, 1, MSG_DONTWAIT | MSG_PEEK) == 0;
    return n;
}

static double percentile(double q)
{
    return n_lat ? lat[(size_t)((double)(n_lat - 1) * q)] : 0;
}

static void report(const struct snapshot *a, const struct snapshot *b)
{
    double secs = (double)(b->at - a->at) / 1e9, span_s = (double)(last_ok - first_ok) / 1e9;
    double cpu = b->cpu - a->cpu, sum = 0;
    unsigned long exc = 0;
    for (int i = 0; i < 256; i++)
        exc += n_exc[i];
    qsort(lat, n_lat, sizeof *lat, cmpf);
    for (size_t i = 0; i < n_lat; i++)
        sum += lat[i];
    putchar('{');
    print_by("ok_by", ok_by);
    print_by("exceptions_by", exc_by);
    printf("\"seconds\":%.4f,\"ok\":%lu,\"rate\":%.2f,\"pace\":%.3f,", secs, ok, (double)ok / secs,
           ok > 1 && span_s > 0 ? (double)(ok - 1) / span_s : 0);
    printf("\"mean_us\":%.1f,\"p50_us\":%.1f,\"p90_us\":%.1f,\"p99_us\":%.1f,\"max_us\":%.1f,\"min_us\":%.1f,",
           n_lat ? sum / (double)n_lat : 0, percentile(.5), percentile(.9), percentile(.99),
           percentile(1), percentile(0));
    printf("\"exceptions\":%lu,\"exc06\":%lu,\"exc0a\":%lu,\"exc0b\":%lu,\"timeouts\":%lu,", exc, n_exc[0x06],
           n_exc[0x0a], n_exc[0x0b], n_timeout);
    printf("\"bad_tid\":%lu,\"bad_unit\":%lu,\"bad_data\":%lu,\"bad_frame\":%lu,\"stale\":%lu,", n_bad_tid,
           n_bad_unit, n_bad_data, n_bad_frame, n_stale);
    printf("\"closed\":%lu,\"sent\":%lu,\"conn_fail\":%d,\"idle_ok\":%d,\"idle_closed\":%d,", n_closed,
           n_sent, conn_fail, idle_ok, idle_closed());
    printf("\"gw_cpu_s\":%.5f,\"gw_cpu_ms_per_1000\":%.3f,\"gw_rss_kb\":%ld,\"gw_csw_per_txn\":%.3f,", cpu,
           ok ? cpu * 1e6 / (double)ok : 0, b->rss_kb, ok ? (double)(b->csw - a->csw) / (double)ok : 0);
    printf("\"load_cpu_s\":%.4f}\n", b->self - a->self);
}

static int parse_args(int argc, char **argv)
{
    for (int i = 1; i < argc; i++) {
        const char *a = argv[i], *v = i + 1 < argc ? argv[i + 1] : "";
        if (!strcmp(a, "--sticky")) { sticky = 1; continue; }
        if (!strcmp(a, "--one-listener")) { one_listener = 1; continue; }
        if (!strcmp(a, "--fresh")) { fresh = 1; continue; }
        if (!strcmp(a, "--random")) { random_think = 1; continue; }
        i++;
        if (!strcmp(a, "--target")) { if (n_targets < MAX_TARGETS) parse_target(v); }
        else if (!strcmp(a, "--line-step")) wire_line_step = (unsigned)atoi(v);
        else if (!strcmp(a, "--conns")) n_conns = atoi(v);
        else if (!strcmp(a, "--pipeline")) pipeline_n = atoi(v);
        else if (!strcmp(a, "--idle")) n_idle = atoi(v);
        else if (!strcmp(a, "--fc")) fc = atoi(v);
        else if (!strcmp(a, "--count")) count = atoi(v);
        else if (!strcmp(a, "--think")) think_ms = atof(v);
        else if (!strcmp(a, "--exc-think")) exc_think_ms = atof(v);
        else if (!strcmp(a, "--span")) span = atoi(v) > 0 ? atoi(v) : 1;
        else if (!strcmp(a, "--warmup")) warmup = atof(v);
        else if (!strcmp(a, "--seconds")) seconds = atof(v);
        else if (!strcmp(a, "--timeout")) timeout_s = atof(v);
        else if (!strcmp(a, "--watch")) { if (n_watch < 128) watch[n_watch++] = atoi(v); }
        else { fprintf(stderr, "load: unknown option %s\n", a); return -1; }
    }
    if (!n_targets || wire_line_step > WIRE_MAX_LINE_STEP ||
        n_conns < 1 || n_conns > MAX_CONNS || n_idle < 0 || n_idle > MAX_CONNS ||
        pipeline_n < 1 || pipeline_n > MAX_PIPE || fc < 1 || fc > 4 || seconds > 3600 ||
        (fresh && (fc < 3 || count < WIRE_STAMP_REGS))) {
        fprintf(stderr, "load: bad arguments\n");
        return -1;
    }
    if (targets[0].rtu)
        pipeline_n = 1;
    return 0;
}

static void open_all(void)
{
    for (int i = 0; i < n_idle; i++) {
        idle_fd[i] = net_open(&targets[i % n_targets]);
        idle_ok += idle_fd[i] >= 0;
    }
    for (int i = 0; i < n_conns; i++) {
        struct conn *c = &conns[i];
        c->t = &targets[i % n_targets];
        c->next_unit = (i / n_targets) % c->t->n_units;
        c->tid = (uint16_t)(i * 37);
        conn_fail += conn_open(c) != 0;
    }
    if (conn_fail == n_conns)
        die("connect");
    for (int i = 0; i < n_conns; i++)
        for (int k = 0; conns[i].fd >= 0 && k < pipeline_n; k++)
            send_one(&conns[i], &conns[i].s[k]);
}

static void expire(int64_t now)
{
    for (int i = 0; i < n_conns; i++)
        for (int k = 0; k < pipeline_n; k++)
            if (conns[i].s[k].used && now - conns[i].s[k].t0 > (int64_t)(timeout_s * 1e9)) {
                n_timeout++;
                conn_reset(&conns[i]);
                break;
            }
}

static int outstanding(void)
{
    int n = 0;
    for (int i = 0; i < n_conns; i++)
        for (int k = 0; k < pipeline_n; k++)
            n += conns[i].s[k].used;
    return n;
}

static void send_due(int64_t now)
{
    for (int i = 0; i < n_conns; i++)
        for (int k = 0; conns[i].fd >= 0 && k < pipeline_n; k++) {
            struct slot *s = &conns[i].s[k];
            if (!s->used && s->due && now >= s->due) {
                s->due = 0;
                send_one(&conns[i], s);
            }
        }
}

static void on_readable(struct conn *c)
{
    ssize_t n = read(c->fd, c->in + c->n_in, sizeof c->in - c->n_in);
    if (n < 0 && (errno == EAGAIN || errno == EINTR))
        return;
    if (n <= 0) {
        n_closed++;
        conn_reset(c);
        return;
    }
    c->n_in += (size_t)n;
    if (c->t->rtu)
        on_rtu(c);
    else
        on_tcp(c);
}

/* One turn of the loop: what is due, then what arrived before `until`. */
static void turn(int64_t until)
{
    static int64_t scanned;
    struct epoll_event ev[256];
    int64_t now = wire_now();
    int thinks = think_ms > 0 || exc_think_ms > 0;
    if (now - scanned > 50000000) {
        scanned = now;
        expire(now);
    }
    if (thinks && running)
        send_due(now);
    int ms = (int)((until - now) / 1000000);
    int r = epoll_wait(ep, ev, 256, thinks ? 1 : ms > 50 ? 50 : ms < 0 ? 0 : ms);
    for (int i = 0; i < r; i++)
        on_readable(ev[i].data.ptr);
}

int main(int argc, char **argv)
{
    struct rlimit rl = { 4096, 4096 };
    wire_init();
    signal(SIGPIPE, SIG_IGN);
    setrlimit(RLIMIT_NOFILE, &rl);
    if (parse_args(argc, argv))
        return 2;
    lat = malloc(MAX_SAMPLES * sizeof *lat);
    ep = epoll_create1(EPOLL_CLOEXEC);
    open_all();
    int64_t begin = wire_now() + (int64_t)(warmup * 1e9), end = begin + (int64_t)(seconds * 1e9);
    while (wire_now() < begin)
        turn(begin);
    struct snapshot first = take();
    measuring = 1;
    while (wire_now() < end)
        turn(end);
    struct snapshot last = take();
    measuring = running = 0;
    while (outstanding())         /* each is answered, or expires */
        turn(wire_now() + 50000000);
    report(&first, &last);
    return 0;
}
