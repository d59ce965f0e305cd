/* Shared Modbus helpers for the bench tools: CRC-16, LRC, data pattern, clock. */
#ifndef BENCH_WIRE_H
#define BENCH_WIRE_H

#include <stddef.h>
#include <stdint.h>
#include <time.h>

static uint16_t wire_crc_table[256];

static inline void wire_init(void)
{
    for (unsigned i = 0; i < 256; i++) {
        uint16_t c = (uint16_t)i;
        for (int k = 0; k < 8; k++)
            c = (c & 1) ? (uint16_t)((c >> 1) ^ 0xA001) : (uint16_t)(c >> 1);
        wire_crc_table[i] = c;
    }
}

static inline uint16_t wire_crc(const uint8_t *p, size_t n)
{
    uint16_t c = 0xFFFF;
    while (n--)
        c = (uint16_t)((c >> 8) ^ wire_crc_table[(c ^ *p++) & 0xFF]);
    return c;
}

static inline uint8_t wire_lrc(const uint8_t *p, size_t n)
{
    uint8_t s = 0;
    while (n--)
        s = (uint8_t)(s + *p++);
    return (uint8_t)(-s);
}

/* An ASCII frame of these bytes, LRC included. */
static inline size_t wire_hex(const uint8_t *p, size_t n, uint8_t *o)
{
    static const char H[] = "0123456789ABCDEF";
    size_t k = 0;
    o[k++] = ':';
    for (size_t i = 0; i < n; i++) {
        o[k++] = (uint8_t)H[p[i] >> 4];
        o[k++] = (uint8_t)H[p[i] & 15];
    }
    o[k++] = '\r';
    o[k++] = '\n';
    return k;
}

static inline int wire_hexval(uint8_t c)
{
    if (c >= '0' && c <= '9') return c - '0';
    if (c >= 'A' && c <= 'F') return c - 'A' + 10;
    if (c >= 'a' && c <= 'f') return c - 'a' + 10;
    return -1;
}

/* The bytes of an ASCII frame, up to what is no hex; o may be p.  Returns their number. */
static inline size_t wire_unhex(const uint8_t *p, size_t n, uint8_t *o)
{
    size_t k = 0;
    if (n && p[0] == ':')
        for (size_t i = 1; i + 1 < n; i += 2) {
            int h = wire_hexval(p[i]), l = wire_hexval(p[i + 1]);
            if (h < 0 || l < 0)
                break;
            o[k++] = (uint8_t)(h << 4 | l);
        }
    return k;
}

/* Unit u on line i (counted from 0) is known as i * wire_line_step + u: the
 * pattern of its values, and its number where all lines share one listener. */
#define WIRE_MAX_LINE_STEP 20
static unsigned wire_line_step __attribute__((unused)) = WIRE_MAX_LINE_STEP;

/* Registers at the start of an answer that hold a device's time stamp. */
#define WIRE_STAMP_REGS 4

/* Value a fresh device holds in register `addr` of unit `unit` (known as above).
 * The load generator recomputes it, so a reply of another unit, of another line,
 * of another address or with shifted bytes is seen as wrong data. */
static inline uint16_t wire_reg(unsigned unit, unsigned addr)
{
    return (uint16_t)(unit * 2654435761u + addr * 40503u + 0x1234u);
}

static inline int wire_bit(unsigned unit, unsigned addr)
{
    return (wire_reg(unit, addr) >> 3) & 1;
}

static inline int64_t wire_now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

/* Length of a complete request ADU (RTU, with CRC) that starts at p, or 0 when
 * more bytes are needed, or -1 for a function code this bench does not know. */
static inline int wire_rtu_request_len(const uint8_t *p, size_t n)
{
    if (n < 2)
        return 0;
    switch (p[1]) {
    case 1: case 2: case 3: case 4: case 5: case 6:
        return n >= 8 ? 8 : 0;
    case 15: case 16:
        if (n < 7)
            return 0;
        return (int)n >= 9 + p[6] ? 9 + p[6] : 0;
    case 23:
        if (n < 11)
            return 0;
        return (int)n >= 13 + p[10] ? 13 + p[10] : 0;
    default:
        return -1;
    }
}

#endif
