// A line over the page: what went wrong, or for a moment what was done.

import { by, inWordsOfPage } from './dom.js';

const SHOWN_MS = 3500;
let timer = 0;

export function notice(words, isStatus = false) {
  by('notice').firstElementChild.textContent = inWordsOfPage(words);
  by('notice').classList.toggle('status', isStatus);
  by('notice').hidden = false;
  clearTimeout(timer);
  if (isStatus) timer = setTimeout(() => { by('notice').hidden = true; }, SHOWN_MS);
}

/** Take these words away, if they are shown. */
export function withdraw(words) {
  if (by('notice').firstElementChild.textContent === inWordsOfPage(words)) by('notice').hidden = true;
}

export function listenToNotice() {
  by('notice').querySelector('button').addEventListener('click', () => { by('notice').hidden = true; });
}
