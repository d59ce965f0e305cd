// Frames of Modbus as they stand on a line, and what each of their bytes means.
import { _, ngettext } from "./texts.js";

const AREAS = { 1: "coils", 2: "discrete", 3: "holding", 4: "input", 5: "coils", 6: "holding", 15: "coils", 16: "holding", 22: "holding", 23: "holding" };
const AREA_NAMES = { coils: _("coils"), discrete: _("discrete"), input: _("input"), holding: _("holding") };
const FUNCTIONS = {
  1: _("read coils"), 2: _("read discrete"), 3: _("read holding"), 4: _("read input"), 5: _("write coil"), 6: _("write register"), 7: _("exception status"), 8: _("diagnostics"),
  11: _("event counter"), 12: _("event log"), 15: _("write coils"), 16: _("write registers"), 17: _("server ID"), 20: _("read file"), 21: _("write file"), 22: _("mask write"),
  23: _("read and write"), 24: _("read FIFO"), 43: _("identification"),
};
const EXCEPTIONS = {
  1: _("illegal function"), 2: _("illegal data address"), 3: _("illegal data value"), 4: _("server device failure"), 5: _("acknowledge"), 6: _("server device busy"),
  8: _("memory parity error"), 10: _("gateway path unavailable"), 11: _("gateway target failed to respond"),
};
const READS = new Set([1, 2, 3, 4]);
const MOST_VALUES = 16;

export const bytesOf = (hex) => (hex ? hex.split(" ").map((byte) => parseInt(byte, 16)) : []);
export const hexOf = (bytes) => bytes.map((byte) => byte.toString(16).toUpperCase().padStart(2, "0")).join(" ");
const word = (bytes, at) => (bytes[at] << 8) | bytes[at + 1];

/** How many characters a PDU takes on a line, with its unit identifier and its check. */
export const charactersOf = (pduLength, mode) => (mode === "ascii" ? 2 * pduLength + 7 : pduLength + 3);

/** What a request asks for, in words. */
export function requestInWords(pdu) {
  const [code] = pdu;
  const area = AREA_NAMES[AREAS[code]];
  if (READS.has(code) && pdu.length >= 5) return read(area, span(word(pdu, 1), word(pdu, 3)));
  if (code === 5 || code === 6) return write(area, span(word(pdu, 1), 1), value(pdu));
  if ((code === 15 || code === 16) && pdu.length > 6) return write(area, span(word(pdu, 1), word(pdu, 3)), values(pdu.slice(6), code, word(pdu, 3)));
  if (code === 23 && pdu.length > 10) return `${write(area, span(word(pdu, 5), word(pdu, 7)), values(pdu.slice(10), 16))}; ${read(area, span(word(pdu, 1), word(pdu, 3)))}`;
  return code === undefined ? _("withheld by [[access]]") : functionNamed(code);
}

/** What a response says to a request, in words. */
export function responseInWords(pdu, request) {
  const [code] = pdu;
  if (code === undefined) return _("withheld by [[access]]");
  if (code & 0x80) return exceptionInWords(pdu[1]);
  if (READS.has(code) || code === 23) return values(pdu.slice(2), code, READS.has(request[0]) ? word(request, 3) : undefined);
  return AREAS[code] ? _("written") : functionNamed(code);
}

/** The parts of a frame on the line: `{bytes, means}`. */
export function parts(unit, pdu, mode, isRequest) {
  if (!pdu.length) return [];
  const body = [unit, ...pdu];
  const check = mode === "tcp" ? [] : mode === "ascii" ? [{ bytes: hexOf([lrc(body)]), means: "LRC" }] : [{ bytes: hexOf(crc(body)), means: "CRC" }];
  return [{ bytes: hexOf([unit]), means: _("address") }, ...pduParts(pdu, isRequest), ...check];
}

function pduParts(pdu, isRequest) {
  const [code] = pdu;
  const part = (from, to, means) => ({ bytes: hexOf(pdu.slice(from, to)), means });
  const head = part(0, 1, FUNCTIONS[code & 0x7f] ?? functionNamed(code & 0x7f));
  if (code & 0x80) return [head, part(1, 2, exceptionInWords(pdu[1]))];
  if (isRequest && READS.has(code)) return [head, part(1, 3, from(word(pdu, 1))), part(3, 5, _("count %(count)s", { count: word(pdu, 3) }))];
  if (READS.has(code) || (code === 23 && !isRequest)) return [head, part(1, 2, size(pdu[1])), part(2, undefined, values(pdu.slice(2), code))];
  if (code === 5 || code === 6) return [head, part(1, 3, from(word(pdu, 1))), part(3, 5, value(pdu))];
  if (code === 15 || code === 16) {
    const place = [head, part(1, 3, from(word(pdu, 1))), part(3, 5, _("count %(count)s", { count: word(pdu, 3) }))];
    return isRequest ? [...place, part(5, 6, size(pdu[5])), part(6, undefined, values(pdu.slice(6), code))] : place;
  }
  return pdu.length > 1 ? [head, part(1, undefined, _("data"))] : [head];
}

const read = (area, addresses) => _("read %(area)s %(addresses)s", { area, addresses });
const write = (area, addresses, value) => _("write %(area)s %(addresses)s = %(value)s", { area, addresses, value });
const functionNamed = (code) => _("function %(code)s", { code });
const from = (address) => _("from %(address)s", { address });
const size = (bytes) => ngettext("%(count)s byte", "%(count)s bytes", bytes);
const span = (first, count) => (count > 1 ? `${first}-${first + count - 1}` : `${first}`);
const value = (pdu) => (pdu[0] === 5 ? (pdu[3] ? _("on") : _("off")) : `${word(pdu, 3)}`);

const exceptionInWords = (code) => _("exception %(code)s", { code: hexOf([code]) }) + (EXCEPTIONS[code] ? `, ${EXCEPTIONS[code]}` : "");

function values(data, code, count) {
  const isBits = code === 1 || code === 2 || code === 15;
  const all = isBits
    ? data.flatMap((byte) => Array.from({ length: 8 }, (_each, bit) => (byte >> bit) & 1)).slice(0, count)
    : Array.from({ length: data.length >> 1 }, (_each, at) => word(data, 2 * at));
  const shown = all.slice(0, MOST_VALUES).join(" ");
  return all.length > MOST_VALUES ? _("%(values)s and %(count)s more", { values: shown, count: all.length - MOST_VALUES }) : shown;
}

function crc(bytes) {
  let sum = 0xffff;
  for (const byte of bytes) {
    sum ^= byte;
    for (let bit = 0; bit < 8; bit++) sum = sum & 1 ? (sum >> 1) ^ 0xa001 : sum >> 1;
  }
  return [sum & 0xff, sum >> 8];
}

const lrc = (bytes) => -bytes.reduce((sum, byte) => sum + byte, 0) & 0xff;
