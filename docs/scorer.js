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

const stemmer = new Stemmer();
const stemsOf = (text) => new Set(splitQuery(text.toLowerCase()).map((word) => stemmer.stemWord(word)));

/** The section of each page whose title has most of the words: `[share, title, anchor]` by page. */
function sectionsWith(weights) {
  const best = new Map();
  for (const [title, places] of Object.entries(Search._index.alltitles)) {
    let share = 0;
    for (const stem of stemsOf(title)) share += weights.get(stem) ?? 0;
    for (const [file, id] of share ? places : []) {
      const page = Search._index.docnames[file];
      if (id && share > (best.get(page)?.[0] ?? 0)) best.set(page, [share, title, `#${id}`]);
    }
  }
  return best;
}

/** Sphinx wants all words on a page, and ranks it by the best of them. Here each word counts, and a rare one more. */
const ofOneWord = Search.performTermsSearch;
Search.performTermsSearch = (words, excluded) => {
  const found = new Map();
  const weights = new Map();
  for (const word of words) {
    const hits = ofOneWord(new Set([word]), excluded);
    const weight = Math.log(1 + Search._index.docnames.length / (1 + hits.length));
    weights.set(word, weight);
    for (const hit of hits) {
      const before = found.get(hit[0])?.[4] ?? 0;
      hit[4] = before + hit[4] * weight;
      found.set(hit[0], hit);
    }
  }
  const all = [...weights.values()].reduce((sum, weight) => sum + weight, 0);
  const sections = sectionsWith(weights);
  for (const hit of found.values()) {
    hit[4] /= all;
    const [, title, anchor] = sections.get(hit[0]) ?? [];
    if (anchor) [hit[1], hit[2]] = [`${hit[1]} > ${title}`, anchor];
  }
  return [...found.values()];
};
