// How the search of the site orders what it finds: pages that say what to do come before those that say why.
// The figures are those of Sphinx; `score`, `PLACES` and `performTermsSearch` are ours.
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

/** Sphinx wants all words on a page, and ranks it by the best of them. Here each word counts, and a rare one more. */
const ofOneWord = Search.performTermsSearch;
Search.performTermsSearch = (words, excluded) => {
  const found = new Map();
  let sum = 0;
  for (const word of words) {
    const hits = ofOneWord(new Set([word]), excluded);
    const weight = Math.log(1 + Search._index.docnames.length / (1 + hits.length));
    sum += weight;
    for (const [page, title, anchor, descr, score, ...rest] of hits) {
      const before = found.get(page)?.[4] ?? 0;
      found.set(page, [page, title, anchor, descr, before + score * weight, ...rest]);
    }
  }
  for (const hit of found.values()) hit[4] /= sum;
  return [...found.values()];
};
