// Asks the search of the site as users do, and fails if the right page is not found soon: node tests/docs/first_hits.js dist/site
"use strict";
const { readFileSync } = require("node:fs");
const { join } = require("node:path");
const vm = require("node:vm");

/** What users type, and the page that they should find first; with `#`, the section too. */
const SOUGHT = {
  "word order": "addressing",
  "exception 0B": "troubleshooting#exceptions-from-the-gateway",
  "two masters": "lines-and-devices#rs-485-baud-rate-parity-two-masters",
  "permission denied": "service#permissions",
  slow: "troubleshooting",
  "baud rate": "lines-and-devices",
  "home assistant": "plant#home-assistant",
  backup: "service#backup",
  "write a register": "tools#read-and-write-values",
  "RS-485 termination": "wiring",
  "rs485 direction control": "lines-and-devices#rs-485-baud-rate-parity-two-masters",
  "change port 502": "service#other-addresses",
  "client gets no answer": "troubleshooting#a-device-does-not-answer",
  "rollback config": "web#the-last-configs-in-use",
  timeout: "lines-and-devices#timeouts-and-late-responses",
  "unit 0 broadcast": "clients-and-rights",
  "TLS certificate": "certificates",
  docker: "service#docker-and-podman",
  "several clients": "clients-and-rights",
  "modbus over serial server": "lines-and-devices#device-servers",
  kepware: "coming-from",
  simulate: "tools#simulate-a-device",
  "user password": "web#users-passwords-access-from-other-machines",
  "mqtt outage": "plant#while-the-broker-is-away",
  "cable length": "wiring#how-long-how-many",
  "write not allowed": "clients-and-rights#access-rights",
  "duplicate address": "lines-and-devices#rs-485-baud-rate-parity-two-masters",
  "add a new meter": "tutorials/describe-a-device",
  "0x0B": "troubleshooting#exceptions-from-the-gateway",
  license: "faq",
  超时: "zh/symptoms",
  波特率: "zh/bridge",
};

/** Questions that docs/search.toml does not help, and a page that is among the first three hits. */
const UNAIDED = {
  "why exception 0B": "symptoms",
  "timeout too short": "lines-and-devices",
  "response too late": "lines-and-devices",
  "read float wrong": "addressing",
  "swap bytes": "addressing",
  "permission denied ttyUSB0": "service",
  "modbus tcp port 502 refused": "clients-and-rights",
  "which unit id": "clients-and-rights",
  "how fast can I poll": "tools",
  "write single register blocked": "clients-and-rights",
  "allow one client to write": "clients-and-rights",
  "read only user": "web",
  "who changed a register": "clients-and-rights",
  "set max value of a setpoint": "functions",
  "log to file": "service",
  "docker serial device": "service",
  "reload config without restart": "service",
  "gateway does not start": "symptoms",
  "usb adapter unplugged": "lines-and-devices",
  "change baud rate": "lines-and-devices",
  "listen on existing bus": "lines-and-devices",
  "connect hmi by serial cable": "clients-and-rights",
  "moxa nport settings": "coming-from",
  "device stops answering at night": "troubleshooting",
  "poll several clients slow": "clients-and-rights",
  "scan for devices": "tools",
  "simulate a meter": "tools",
  "wireshark capture": "tools",
  "values are stale": "images",
  "send values to influxdb": "plant",
  "metrics grafana": "metrics",
  "open page from another computer": "web",
  "two gateways redundant": "fleet",
  "sd card wear": "sizing",
};

/** The search that Sphinx has put into the site, with an index and without a page. */
function searchOf(site) {
  const page = {
    document: { addEventListener() {}, getElementById: () => ({}) },
    addEventListener() {},
    Documentation: { ready() {} },
    _ready() {},
    _: (text) => text,
    SPHINX_HIGHLIGHT_ENABLED: false,
  };
  page.window = vm.createContext(page);
  for (const file of ["_static/searchtools.js", "_static/language_data.js", "searchindex.js"])
    vm.runInContext(readFileSync(join(site, file), "utf8"), page);
  const engine = vm.runInContext("Search", page);
  return (query) => {
    const [asked, ...terms] = engine._parseQuery(query);
    return engine._performSearch(asked, ...terms).reverse().map(([name, , anchor]) => name + anchor);
  };
}

const search = searchOf(process.argv[2] ?? "dist/site");
let missed = 0;
for (const [questions, within] of [[SOUGHT, 1], [UNAIDED, 3]]) {
  const ranks = [];
  for (const [query, wanted] of Object.entries(questions)) {
    const hits = search(query);
    const rank = hits.findIndex((hit) => hit === wanted || hit.split("#")[0] === wanted) + 1;
    ranks.push(rank);
    const isMissed = !rank || rank > within;
    missed += isMissed;
    if (isMissed || process.argv.includes("-v"))
      console.log(`${query}: ${rank ? `rank ${rank}` : "not found"}: ${wanted}; first is ${hits[0] ?? "nothing"}`);
  }
  console.log(`${ranks.filter((rank) => rank === 1).length} of ${ranks.length} find their page first`);
}
process.exitCode = missed ? 1 : 0;
