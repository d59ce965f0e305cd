/*
 * relay - a bare relay of Modbus TCP to RTU or ASCII: the floor of all figures.
 *
 *   relay [--ascii] [--gap --baud N [--bits N] [--each-byte]] TTY=PORT[:FROM-TO] ...
 *
 *   TTY=PORT           every unit asked for on 127.0.0.1:PORT lives on TTY
 *   TTY=PORT:FROM-TO   units FROM..TO of that port are units 1.. on TTY; so
 *                      several lines share one listener
 *   --gap              keep t3.5 between a response and the next request (RTU),
 *                      and do not look at the line before a response can be
 *                      complete (timerfd); needs --baud, --bits is 10 (8N1) by default
 *   --each-byte        wake up for each byte of a response all the same: what
 *                      it costs who does not know how long a response will be
 *
 * It does what no gateway can leave out: read the socket, cut the stream into
 * ADUs, queue per line, add the check sum, write the line, read it, check the sum,
 * write the socket.  No time-outs, no checks of the PDU, no statistics, no
 * logs: a unit that does not answer holds its line for ever.
 */
#define _GNU_SOURCE
#include "wire.h"

#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/timerfd.h>
#include <termios.h>
#include <unistd.h>

#define MAX_LINES 64
#define MAX_CLIENTS 4096
#define QUEUE 1024                /* per line, a power of two */
#define ADU 260

/* What epoll knows: who to call with what. */
struct source {
    void (*ready)(void *);
    void *self;
};

struct client {
    struct source source;
    int fd, port;
    unsigned serial;              /* tells a client from the next one on the same descriptor */
    uint8_t in[2 * ADU];
    size_t n_in;
};

struct request {
    struct client *client;
    unsigned serial;
    uint8_t tid[2], asked_unit;
    uint8_t frame[ADU];           /* unit on the wire, PDU, CRC or LRC */
    size_t n;
};

struct line {
    struct source bytes, quiet;
    int fd, timer, port, from, to;
    struct request queue[QUEUE];  /* head .. tail - 1; the head is on the line while busy */
    unsigned head, tail;
    int busy;
    int64_t quiet_at;             /* --gap: earliest start of the next request */
    uint8_t in[2 * ADU];
    size_t n_in;
};

struct listener {
    struct source source;
    int fd, port;
};

static struct line lines[MAX_LINES];
static struct listener listeners[MAX_LINES];
static struct client clients[MAX_CLIENTS];
static int n_lines, n_listeners, ep, ascii;
static int64_t gap_ns, char_ns;   /* char_ns: 0 to wake for each byte */

static void die(const char *what)
{
    perror(what);
    exit(1);
}

static void watch(int fd, struct source *s, void (*ready)(void *), void *self)
{
    *s = (struct source){ ready, self };
    struct epoll_event e = { .events = EPOLLIN, .data.ptr = s };
    if (epoll_ctl(ep, EPOLL_CTL_ADD, fd, &e))
        die("epoll_ctl");
}

/* ── lines ─────────────────────────────────────────────────────────────────── */

/* Size of the RTU response, foretold from its request. */
static size_t response_size(const uint8_t *q)
{
    size_t quantity = (size_t)q[4] << 8 | q[5];
    switch (q[1]) {
    case 1: case 2: return 5 + (quantity + 7) / 8;
    case 3: case 4: case 23: return 5 + 2 * quantity;
    default: return 8;
    }
}

/* Characters on the line of a response of this size. */
static size_t on_line(size_t response)
{
    return ascii ? 2 * response + 1 : response;
}

static int is_exception(const struct line *l)
{
    return ascii ? l->n_in > 3 && l->in[3] >= '8' : l->n_in > 1 && l->in[1] & 0x80;
}

/* Whether the check sum is right.  An ASCII response is then bytes, as an RTU response is. */
static int is_whole(struct line *l, size_t size)
{
    if (!ascii)
        return wire_crc(l->in, size) == 0;
    return wire_unhex(l->in, on_line(size), l->in) == size - 1 && wire_lrc(l->in, size - 1) == 0;
}

static void wake_at(struct line *l, int64_t wait)
{
    struct itimerspec t = { .it_value = { wait / 1000000000, wait % 1000000000 } };
    timerfd_settime(l->timer, 0, &t, NULL);
}

static void look(struct line *l, uint32_t events)
{
    struct epoll_event e = { .events = events, .data.ptr = &l->bytes };
    if (epoll_ctl(ep, EPOLL_CTL_MOD, l->fd, &e))
        die("epoll_ctl");
}

/* Puts the oldest request on the line if the line is free and was quiet long enough. */
static void start(struct line *l)
{
    if (l->busy || l->head == l->tail)
        return;
    int64_t wait = gap_ns ? l->quiet_at - wire_now() : 0;
    if (wait > 0) {
        wake_at(l, wait);
        return;
    }
    struct request *r = &l->queue[l->head % QUEUE];
    l->busy = 1;
    l->n_in = 0;
    uint8_t hex[2 * ADU], *frame = ascii ? hex : r->frame;
    size_t n = ascii ? wire_hex(r->frame, r->n, hex) : r->n;
    if (write(l->fd, frame, n) != (ssize_t)n)
        die("line");
    if (char_ns) {                /* else each byte of the response would wake us */
        look(l, 0);
        wake_at(l, (int64_t)(n + on_line(response_size(r->frame))) * char_ns + gap_ns);
    }
}

static void respond(const struct request *r, const uint8_t *pdu, size_t n)
{
    uint8_t out[ADU] = { r->tid[0], r->tid[1], 0, 0, (uint8_t)((n + 1) >> 8), (uint8_t)(n + 1), r->asked_unit };
    memcpy(out + 7, pdu, n);
    if (r->client->serial == r->serial)
        write(r->client->fd, out, n + 7);
}

static void on_quiet(void *self)
{
    struct line *l = self;
    uint64_t n;
    read(l->timer, &n, sizeof n);
    if (l->busy)
        look(l, EPOLLIN);
    else
        start(l);
}

static void on_bytes(void *self)
{
    struct line *l = self;
    ssize_t n = read(l->fd, l->in + l->n_in, sizeof l->in - l->n_in);
    if (n <= 0 || !l->busy)
        return;
    l->n_in += (size_t)n;
    struct request *r = &l->queue[l->head % QUEUE];
    size_t size = is_exception(l) ? 5 : response_size(r->frame);
    if (l->n_in < on_line(size))
        return;
    if (gap_ns)
        l->quiet_at = wire_now() + gap_ns;
    l->busy = 0;
    l->head++;
    start(l);                     /* the line first, the client after it */
    if (is_whole(l, size)) {
        respond(r, l->in + 1, size - 3);
    } else {
        uint8_t failed[2] = { r->frame[1] | 0x80, 0x0B };
        respond(r, failed, sizeof failed);
    }
}

/* ── clients ───────────────────────────────────────────────────────────────── */

static struct line *line_of(int port, int unit)
{
    for (int i = 0; i < n_lines; i++)
        if (lines[i].port == port && unit >= lines[i].from && unit <= lines[i].to)
            return &lines[i];
    return NULL;
}

/* adu: one whole MBAP ADU; n: unit and PDU, without the six bytes before them */
static void submit(struct client *c, const uint8_t *adu, size_t n)
{
    struct line *l = line_of(c->port, adu[6]);
    if (!l || l->tail - l->head == QUEUE)
        return;
    struct request *r = &l->queue[l->tail++ % QUEUE];
    *r = (struct request){ .client = c, .serial = c->serial, .tid = { adu[0], adu[1] }, .asked_unit = adu[6] };
    memcpy(r->frame, adu + 6, n);
    r->frame[0] = (uint8_t)(l->from ? adu[6] - l->from + 1 : adu[6]);
    uint16_t sum = ascii ? wire_lrc(r->frame, n) : wire_crc(r->frame, n);
    r->frame[n] = (uint8_t)sum;
    r->frame[n + 1] = (uint8_t)(sum >> 8);
    r->n = ascii ? n + 1 : n + 2;
    start(l);
}

static void leave(struct client *c)
{
    c->serial++;
    close(c->fd);
}

static void on_client(void *self)
{
    struct client *c = self;
    ssize_t got = read(c->fd, c->in + c->n_in, sizeof c->in - c->n_in);
    if (got < 0)
        return;
    if (got == 0) {
        leave(c);
        return;
    }
    size_t pos = 0;
    c->n_in += (size_t)got;
    while (c->n_in - pos >= 8) {
        const uint8_t *adu = c->in + pos;
        size_t n = (size_t)adu[4] << 8 | adu[5];
        if (n < 2 || n > 254) {
            leave(c);
            return;
        }
        if (c->n_in - pos < 6 + n)
            break;
        submit(c, adu, n);
        pos += 6 + n;
    }
    memmove(c->in, c->in + pos, c->n_in - pos);
    c->n_in -= pos;
}

static void on_connect(void *self)
{
    struct listener *l = self;
    int one = 1, fd = accept4(l->fd, NULL, NULL, SOCK_NONBLOCK | SOCK_CLOEXEC);
    if (fd < 0)
        return;
    if (fd >= MAX_CLIENTS) {
        close(fd);
        return;
    }
    struct client *c = &clients[fd];
    setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &one, sizeof one);
    c->fd = fd;
    c->port = l->port;
    c->n_in = 0;
    watch(fd, &c->source, on_client, c);
}

/* ── start-up ──────────────────────────────────────────────────────────────── */

static void listen_on(int port)
{
    for (int i = 0; i < n_listeners; i++)
        if (listeners[i].port == port)
            return;
    struct listener *l = &listeners[n_listeners++];
    struct sockaddr_in a = { .sin_family = AF_INET, .sin_port = htons((uint16_t)port),
                             .sin_addr.s_addr = htonl(INADDR_LOOPBACK) };
    int one = 1;
    l->port = port;
    l->fd = socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    setsockopt(l->fd, SOL_SOCKET, SO_REUSEADDR, &one, sizeof one);
    if (bind(l->fd, (struct sockaddr *)&a, sizeof a) || listen(l->fd, 1024))
        die("listen");
    watch(l->fd, &l->source, on_connect, l);
}

static void open_tty(struct line *l, const char *path)
{
    struct termios t;
    l->fd = open(path, O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
    if (l->fd < 0 || tcgetattr(l->fd, &t))
        die(path);
    cfmakeraw(&t);
    tcsetattr(l->fd, TCSANOW, &t);
    watch(l->fd, &l->bytes, on_bytes, l);
    l->timer = timerfd_create(CLOCK_MONOTONIC, TFD_NONBLOCK | TFD_CLOEXEC);
    watch(l->timer, &l->quiet, on_quiet, l);
}

/* TTY=PORT[:FROM-TO] */
static void add_line(char *arg)
{
    struct line *l = &lines[n_lines];
    char *eq = strrchr(arg, '=');
    if (!eq || n_lines == MAX_LINES) {
        fprintf(stderr, "relay: bad argument %s\n", arg);
        exit(2);
    }
    *eq = 0;
    l->to = 255;
    sscanf(eq + 1, "%d:%d-%d", &l->port, &l->from, &l->to);
    n_lines++;
    open_tty(l, arg);
    listen_on(l->port);
}

int main(int argc, char **argv)
{
    int keep_gap = 0, each_byte = 0;
    long baud = 0, bits = 10;
    struct epoll_event ev[64];
    wire_init();
    signal(SIGPIPE, SIG_IGN);
    prctl(PR_SET_TIMERSLACK, 1UL);
    ep = epoll_create1(EPOLL_CLOEXEC);
    for (int i = 1; i < argc; i++) {
        if (!strcmp(argv[i], "--gap"))
            keep_gap = 1;
        else if (!strcmp(argv[i], "--ascii"))
            ascii = 1;
        else if (!strcmp(argv[i], "--each-byte"))
            each_byte = 1;
        else if (!strcmp(argv[i], "--baud") && i + 1 < argc)
            baud = atol(argv[++i]);
        else if (!strcmp(argv[i], "--bits") && i + 1 < argc)
            bits = atol(argv[++i]);
        else
            add_line(argv[i]);
    }
    if (!n_lines || (keep_gap && baud <= 0)) {
        fprintf(stderr, "usage: relay [--ascii] [--gap --baud N [--bits N] [--each-byte]] TTY=PORT[:FROM-TO] ...\n");
        return 2;
    }
    if (keep_gap) {
        long long character = bits * 1000000000LL / baud;
        gap_ns = ascii ? 0 : baud > 19200 ? 1750000 : character * 7 / 2;
        char_ns = each_byte ? 0 : character;
    }
    for (;;) {
        int n = epoll_wait(ep, ev, 64, -1);
        for (int i = 0; i < n; i++) {
            struct source *s = ev[i].data.ptr;
            s->ready(s->self);
        }
    }
}
