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
