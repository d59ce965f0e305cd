// How the search of the site orders what it finds: pages that say what to do come before those that say why.
// The figures are those of Sphinx; `score` and `PLACES` are ours.
"use strict";

/** What is added for a page below a folder, or with this name. */
const PLACES = [
  [/^(symptoms|troubleshooting|faq)$/, 2],
  [/^(adr\/|api$|architecture$|own-registers$|promise$|performance$|comparison$)/, -4],
  [/^profiles\/./, -3],
  [/^zh\//, -5],
  [/^(tutorials\/|configuration$|index$)/, -1],
];

// eslint-disable-next-line no-unused-vars
var Scorer = {
  score: ([page, , , , score]) => score + (PLACES.find(([name]) => name.test(page)) ?? [null, 0])[1],
  objNameMatch: 11,
  objPartialMatch: 0,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};
