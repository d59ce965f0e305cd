/*
 * devices - Modbus RTU and ASCII devices on N pseudo-terminals.
 *
 *   devices --link tty0 --link tty1 --units 1-10 [options]
 *
 *   --link PATH      make one port and put a symlink to its tty side at PATH
 *   --units LIST     unit ids answered on every port, e.g. 1-10,20 (default 1-247)
 *   --line-step N    how far the values of equal units of two ports are apart (wire.h)
 *   --dead LIST      unit ids that never answer
 *   --dead-port I    no unit of port I (counted from 0) ever answers
 *   --stamp          the first four registers of every read are the CLOCK_MONOTONIC
 *                    time in ns at which the request's first byte arrived
 *   --count          all other registers of a read are the number of reads that the
 *                    unit has answered
 *   --ascii          Modbus ASCII instead of RTU
 *   --delay FC:US    reply delay of one function code in microseconds
 *                    (FC 0 = every function); may be repeated
 *   --late N:US      every N-th request is answered US microseconds later than others
 *   --baud N         line pacing: model a serial line of N baud (0 = no pacing)
 *   --bits N         bits per character when pacing (default 11; 8N1 is 10)
 *   --t35 US         silence in us (default: 3.5 chars, 1750 above 19200, ASCII 0)
 *   --fifo N         receiver hands the gateway N bytes at a time (default 1)
 *   --strict US      a request that starts less than US microseconds after the
 *                    previous reply is not understood (no answer); 0 = off
 *   --seconds N      hard stop (default 300)
 *
 * On SIGTERM/SIGINT it prints one JSON line of counters and ends.
 *
 * Line model (--baud): a byte that the gateway writes at time T occupies the
 * line from max(T, line free) for one character time.  A device has the frame
 * when t3.5 passed after its last character.  The reply's bytes become readable
 * one character time apart.  `gap` is the silence between the last byte of the
 * previous reply and the first byte of the next request: a gap below t3.5 is
 * counted as a violation (a real multi-drop device may merge the two frames).
 *
 * The values of a unit depend on its port (wire.h), so a request that went to
 * the wrong line is seen as wrong data.
 */
#define _GNU_SOURCE
#include "wire.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <termios.h>
#include <unistd.h>

#define MAX_PORTS 64
#define BUF 600

struct port {
    int master, keep;             /* keep: tty side held open, so no EIO */
    char link[256];
    uint8_t in[BUF];
    size_t n_in;
    uint8_t out[BUF];
    size_t n_out, sent;
    int64_t line_free;            /* paced: end of the last request character */
    int64_t frame_at;             /* paced: when the frame counts as complete */
    int64_t out_start;            /* first reply byte starts on the line */
    int64_t reply_end;            /* end of the previous reply on the line */
    int64_t begun;                /* when the request's first byte arrived */
    int spoiled;                  /* --strict: this request will not be understood */
    uint16_t count[256];          /* --count: reads answered by a unit */
    uint16_t *regs[256];
    uint8_t *bits[256];
};

static struct port ports[MAX_PORTS];
static int n_ports;
static uint8_t unit_ok[256], unit_dead[256];
static int64_t delay_ns[256];
static int64_t late_ns;
static unsigned long late_each;
static int ascii, stamp, counts, dead_port = -1, fifo = 1;
static int64_t char_ns, t35_ns, strict_ns;
static volatile sig_atomic_t stop;
static struct {
    unsigned long requests, replies, dead, crc_errors, foreign, merged, early;
    unsigned long gap_violations, spoiled;
    int64_t min_gap, gap_sum, busy_ns, first, last;
    unsigned long gaps;
} st;

static void on_signal(int s) { (void)s; stop = 1; }

static void parse_list(const char *s, uint8_t *set)
{
    while (*s) {
        char *e;
        long a = strtol(s, &e, 10), b = a;
        if (*e == '-')
            b = strtol(e + 1, &e, 10);
        for (long i = a; i <= b && i < 256; i++)
            if (i >= 0)
                set[i] = 1;
        s = *e == ',' ? e + 1 : e;
        if (*e && *e != ',')
            break;
    }
}

static unsigned known_as(const struct port *p, unsigned u)
{
    return (unsigned)(p - ports) * wire_line_step + u;
}

static uint16_t *regs_of(struct port *p, unsigned u)
{
    if (!p->regs[u]) {
        p->regs[u] = malloc(65536 * sizeof(uint16_t));
        for (unsigned a = 0; a < 65536; a++)
            p->regs[u][a] = wire_reg(known_as(p, u), a);
    }
    return p->regs[u];
}

static uint8_t *bits_of(struct port *p, unsigned u)
{
    if (!p->bits[u]) {
        p->bits[u] = malloc(65536);
        for (unsigned a = 0; a < 65536; a++)
            p->bits[u][a] = (uint8_t)wire_bit(known_as(p, u), a);
    }
    return p->bits[u];
}

static unsigned be16(const uint8_t *p) { return (unsigned)p[0] << 8 | p[1]; }

static void put_stamp(uint8_t *p, int64_t t)
{
    for (int i = 2 * WIRE_STAMP_REGS - 1; i >= 0; i--, t >>= 8)
        p[i] = (uint8_t)t;
}

/* Builds the reply PDU (unit id first, no check code); 0 = stay silent. */
static size_t build_reply(struct port *p, const uint8_t *q, size_t n, uint8_t *r)
{
    unsigned u = q[0], fc = q[1], a, c, i;
    int ex = 0;
    size_t len = 2;
    r[0] = q[0];
    r[1] = q[1];
    if (n < 6) {
        ex = 1;
        goto done;
    }
    a = be16(q + 2);
    c = be16(q + 4);
    switch (fc) {
    case 1: case 2: {
        if (c < 1 || c > 2000) { ex = 3; break; }
        if (a + c > 65536) { ex = 2; break; }
        uint8_t *b = bits_of(p, u);
        r[2] = (uint8_t)((c + 7) / 8);
        memset(r + 3, 0, r[2]);
        for (i = 0; i < c; i++)
            if (b[a + i])
                r[3 + i / 8] |= (uint8_t)(1u << (i % 8));
        len = 3u + r[2];
        break;
    }
    case 3: case 4: {
        if (c < 1 || c > 125) { ex = 3; break; }
        if (a + c > 65536) { ex = 2; break; }
        uint16_t *g = regs_of(p, u);
        r[2] = (uint8_t)(2 * c);
        p->count[u]++;
        for (i = 0; i < c; i++) {
            uint16_t v = counts ? p->count[u] : g[a + i];
            r[3 + 2 * i] = (uint8_t)(v >> 8);
            r[4 + 2 * i] = (uint8_t)v;
        }
        if (stamp && c >= WIRE_STAMP_REGS)
            put_stamp(r + 3, p->begun);
        len = 3u + r[2];
        break;
    }
    case 5:
        bits_of(p, u)[a] = c == 0xFF00;
        memcpy(r, q, 6);
        len = 6;
        break;
    case 6:
        regs_of(p, u)[a] = (uint16_t)c;
        memcpy(r, q, 6);
        len = 6;
        break;
    case 15: case 16:
        if (n < 7u + q[6] || a + c > 65536 || c == 0) { ex = 3; break; }
        if (fc == 16)
            for (i = 0; i < c && 8 + 2 * i < n; i++)
                regs_of(p, u)[a + i] = (uint16_t)be16(q + 7 + 2 * i);
        else
            for (i = 0; i < c && 7 + i / 8 < n; i++)
                bits_of(p, u)[a + i] = (q[7 + i / 8] >> (i % 8)) & 1;
        memcpy(r, q, 6);
        len = 6;
        break;
    case 23: {
        if (n < 11) { ex = 3; break; }
        unsigned wa = be16(q + 6), wc = be16(q + 8);
        if (c < 1 || c > 125 || a + c > 65536 || wa + wc > 65536) { ex = 3; break; }
        uint16_t *g = regs_of(p, u);
        for (i = 0; i < wc && 12 + 2 * i < n; i++)
            g[wa + i] = (uint16_t)be16(q + 11 + 2 * i);
        r[2] = (uint8_t)(2 * c);
        p->count[u]++;
        for (i = 0; i < c; i++) {
            uint16_t v = counts ? p->count[u] : g[a + i];
            r[3 + 2 * i] = (uint8_t)(v >> 8);
            r[4 + 2 * i] = (uint8_t)v;
        }
        len = 3u + r[2];
        break;
    }
    default:
        ex = 1;
    }
done:
    if (ex) {
        r[1] |= 0x80;
        r[2] = (uint8_t)ex;
        len = 3;
    }
    return len;
}

/* q: unit id + PDU without check code.  Queues the reply from time `when`. */
static void serve(struct port *p, const uint8_t *q, size_t n, int64_t when)
{
    uint8_t r[300];
    st.requests++;
    if (!st.first)
        st.first = when;
    st.last = when;
    if (q[0] == 0 || !unit_ok[q[0]]) {
        st.foreign++;
        return;
    }
    if (unit_dead[q[0]] || p - ports == dead_port) {
        st.dead++;
        return;
    }
    size_t len = build_reply(p, q, n, r);
    if (ascii) {
        r[len] = wire_lrc(r, len);
        p->n_out = wire_hex(r, len + 1, p->out);
    } else {
        uint16_t c = wire_crc(r, len);
        memcpy(p->out, r, len);
        p->out[len] = (uint8_t)c;
        p->out[len + 1] = (uint8_t)(c >> 8);
        p->n_out = len + 2;
    }
    p->sent = 0;
    p->out_start = when + (delay_ns[q[1]] ? delay_ns[q[1]] : delay_ns[0]);
    if (late_each && st.requests % late_each == 0)
        p->out_start += late_ns;
    if (char_ns) {
        p->reply_end = p->out_start + (int64_t)p->n_out * char_ns;
        st.busy_ns += (int64_t)p->n_out * char_ns;
    }
    st.replies++;
}

static void frame_done(struct port *p, int64_t when)
{
    if (p->spoiled) {
        p->spoiled = 0;
        p->n_in = 0;
        st.spoiled++;
        return;
    }
    if (ascii) {
        uint8_t b[BUF];
        size_t n = wire_unhex(p->in, p->n_in, b);
        p->n_in = 0;
        if (n < 3 || wire_lrc(b, n - 1) != b[n - 1]) {
            st.crc_errors++;
            return;
        }
        serve(p, b, n - 1, when);
        return;
    }
    size_t n = p->n_in;
    p->n_in = 0;
    if (n < 4 || wire_crc(p->in, n - 2) != (uint16_t)(p->in[n - 2] | p->in[n - 1] << 8)) {
        st.crc_errors++;
        return;
    }
    serve(p, p->in, n - 2, when);
}

static void readable(struct port *p)
{
    if (p->n_in >= BUF - 1)
        p->n_in = 0;
    ssize_t n = read(p->master, p->in + p->n_in, BUF - p->n_in);
    if (n <= 0)
        return;
    int64_t now = wire_now();
    if (p->n_out > p->sent) {
        /* The gateway talks while the reply is still on the line. */
        st.early++;
    }
    if (p->n_in == 0)
        p->begun = now;
    if (!char_ns) {
        p->n_in += (size_t)n;
        if (ascii) {
            uint8_t *lf;
            while (p->n_in && (lf = memchr(p->in, '\n', p->n_in))) {
                size_t len = (size_t)(lf - p->in) + 1, rest = p->n_in - len;
                uint8_t tail[BUF];
                memcpy(tail, p->in + len, rest);
                p->n_in = len;
                frame_done(p, now);
                memcpy(p->in, tail, rest);
                p->n_in = rest;
            }
            return;
        }
        int len = wire_rtu_request_len(p->in, p->n_in);
        if (len < 0)
            len = (int)p->n_in;
        if (len == 0)
            return;
        if ((size_t)len < p->n_in)
            st.merged++;
        p->n_in = (size_t)len;
        frame_done(p, now);
        return;
    }
    if (p->n_in == 0) {
        if (p->reply_end) {
            int64_t gap = now - p->reply_end;
            if (!st.gaps || gap < st.min_gap)
                st.min_gap = gap;
            st.gap_sum += gap;
            st.gaps++;
            /* 20 us allowance for the simulator's own scheduling */
            if (gap < t35_ns - 20000)
                st.gap_violations++;
            p->spoiled = strict_ns && gap < strict_ns;
        }
        p->line_free = now > p->reply_end ? now : p->reply_end;
        p->reply_end = 0;         /* only an answered request is followed by a gap */
    }
    if (p->line_free < now)
        p->line_free = now;
    p->n_in += (size_t)n;
    p->line_free += (int64_t)n * char_ns;
    st.busy_ns += (int64_t)n * char_ns;
    if (ascii)
        p->frame_at = p->in[p->n_in - 1] == '\n' ? p->line_free : 0;
    else
        p->frame_at = p->line_free + t35_ns;
}

/* Sends the reply bytes that are due; returns the time of the next one or 0. */
static int64_t pump(struct port *p, int64_t now)
{
    while (p->sent < p->n_out) {
        size_t k = p->n_out - p->sent;
        int64_t due = p->out_start;
        if (char_ns) {
            if (k > (size_t)fifo)
                k = (size_t)fifo;
            due += (int64_t)(p->sent + k) * char_ns;
        }
        if (due > now)
            return due;
        if (char_ns) {            /* everything that is already due at once */
            size_t m = (size_t)((now - p->out_start) / char_ns);
            if (m >= p->n_out)
                k = p->n_out - p->sent;
            else if (m > p->sent + k)
                k = (m - p->sent) / (size_t)fifo * (size_t)fifo;
        }
        ssize_t w = write(p->master, p->out + p->sent, k);
        if (w <= 0)
            return now + 100000;
        p->sent += (size_t)w;
    }
    return 0;
}

int main(int argc, char **argv)
{
    int64_t baud = 0, bits = 11, t35_us = -1, seconds = 300;
    wire_init();
    for (int i = 1; i < argc; i++) {
        const char *a = argv[i], *v = i + 1 < argc ? argv[i + 1] : "";
        if (!strcmp(a, "--ascii")) { ascii = 1; continue; }
        if (!strcmp(a, "--stamp")) { stamp = 1; continue; }
        if (!strcmp(a, "--count")) { counts = 1; continue; }
        i++;
        if (!strcmp(a, "--link")) {
            if (n_ports < MAX_PORTS)
                snprintf(ports[n_ports++].link, sizeof ports[0].link, "%s", v);
        } else if (!strcmp(a, "--line-step")) wire_line_step = (unsigned)atoi(v);
        else if (!strcmp(a, "--units")) parse_list(v, unit_ok);
        else if (!strcmp(a, "--dead")) parse_list(v, unit_dead);
        else if (!strcmp(a, "--dead-port")) dead_port = atoi(v);
        else if (!strcmp(a, "--delay")) {
            int fc = atoi(v);
            const char *c = strchr(v, ':');
            if (c && fc >= 0 && fc < 256)
                delay_ns[fc] = atoll(c + 1) * 1000;
        } else if (!strcmp(a, "--late")) {
            const char *c = strchr(v, ':');
            late_each = c ? (unsigned long)atol(v) : 0;
            late_ns = c ? atoll(c + 1) * 1000 : 0;
        } else if (!strcmp(a, "--baud")) baud = atoll(v);
        else if (!strcmp(a, "--bits")) bits = atoll(v);
        else if (!strcmp(a, "--t35")) t35_us = atoll(v);
        else if (!strcmp(a, "--fifo")) fifo = atoi(v) > 0 ? atoi(v) : 1;
        else if (!strcmp(a, "--strict")) strict_ns = atoll(v) * 1000;
        else if (!strcmp(a, "--seconds")) seconds = atoll(v);
        else { fprintf(stderr, "devices: unknown option %s\n", a); return 2; }
    }
    if (!n_ports) { fprintf(stderr, "devices: no --link\n"); return 2; }
    int any = 0;
    for (int i = 0; i < 256; i++)
        any |= unit_ok[i];
    if (!any)
        for (int i = 1; i < 248; i++)
            unit_ok[i] = 1;
    if (baud > 0) {
        char_ns = bits * 1000000000LL / baud;
        t35_ns = ascii ? 0 : t35_us >= 0 ? t35_us * 1000
               : baud > 19200 ? 1750000 : char_ns * 7 / 2;
    }
    signal(SIGTERM, on_signal);
    signal(SIGINT, on_signal);
    prctl(PR_SET_TIMERSLACK, 1UL);
    struct pollfd fds[MAX_PORTS];
    for (int i = 0; i < n_ports; i++) {
        struct port *p = &ports[i];
        p->master = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
        if (p->master < 0 || grantpt(p->master) || unlockpt(p->master)) {
            perror("posix_openpt");
            return 1;
        }
        char name[128];
        ptsname_r(p->master, name, sizeof name);
        p->keep = open(name, O_RDWR | O_NOCTTY | O_CLOEXEC);
        struct termios t;
        tcgetattr(p->keep, &t);
        cfmakeraw(&t);
        tcsetattr(p->keep, TCSANOW, &t);
        unlink(p->link);
        if (symlink(name, p->link)) { perror(p->link); return 1; }
        fds[i].fd = p->master;
        fds[i].events = POLLIN;
    }
    int64_t end = wire_now() + seconds * 1000000000LL;
    while (!stop) {
        int64_t now = wire_now(), next = end;
        if (now >= end)
            break;
        for (int i = 0; i < n_ports; i++) {
            struct port *p = &ports[i];
            if (p->frame_at && now >= p->frame_at) {
                int64_t at = p->frame_at;
                p->frame_at = 0;
                frame_done(p, at);
            }
            if (p->frame_at && p->frame_at < next)
                next = p->frame_at;
            int64_t d = pump(p, now);
            if (d && d < next)
                next = d;
        }
        int64_t wait = next - wire_now();
        if (wait < 0)
            wait = 0;
        /* Sleep short of the deadline and spin the rest, for exact pacing. */
        if (next != end && wait > 0)
            wait = wait > 60000 ? wait - 60000 : 0;
        struct timespec ts = { wait / 1000000000, wait % 1000000000 };
        int r = ppoll(fds, (nfds_t)n_ports, &ts, NULL);
        if (r > 0)
            for (int i = 0; i < n_ports; i++)
                if (fds[i].revents & POLLIN)
                    readable(&ports[i]);
    }
    for (int i = 0; i < n_ports; i++)
        unlink(ports[i].link);
    printf("{\"requests\":%lu,\"replies\":%lu,\"dead\":%lu,\"crc_errors\":%lu,"
           "\"foreign\":%lu,\"merged\":%lu,\"early\":%lu,\"spoiled\":%lu,\"gap_violations\":%lu,"
           "\"gaps\":%lu,\"min_gap_us\":%.1f,\"mean_gap_us\":%.1f,\"t35_us\":%.1f,"
           "\"line_busy_s\":%.4f,\"span_s\":%.4f}\n",
           st.requests, st.replies, st.dead, st.crc_errors, st.foreign, st.merged,
           st.early, st.spoiled, st.gap_violations, st.gaps, st.min_gap / 1e3,
           st.gaps ? st.gap_sum / 1e3 / (double)st.gaps : 0.0, t35_ns / 1e3,
           st.busy_ns / 1e9, (st.last - st.first) / 1e9);
    return 0;
}
