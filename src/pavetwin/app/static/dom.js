/** An element with properties and children. */
export function element(name, properties = {}, ...children) {
  const made = Object.assign(document.createElement(name), properties);
  made.append(...children);
  return made;
}

export const by = id => document.getElementById(id);

/** Fill a select with values, or with [value, words]. */
export function fillSelect(select, choices, chosen) {
  select.replaceChildren(...choices.map(choice => {
    const [value, words] = Array.isArray(choice) ? choice : [choice, choice.replaceAll('_', ' ')];
    return new Option(words, value, value === chosen, value === chosen);
  }));
}

/** Of the parameters that the library names in backquotes, those whose control has another name. */
const CONTROLS = { count: 'Number of segments', 'count=None': 'A, with the whole town in view,' };

/** A message of the library in the words of the page: parameters in backquotes become the labels of their controls. */
export function inWordsOfPage(message) {
  const label = name => by('mission')?.elements?.[name]?.closest?.('label')?.firstChild.textContent;
  return message.replace(/`([\w=]+)`/g, (text, name) => CONTROLS[name] ?? label(name) ?? text);
}
