// Helpers for the text beside the map.

export const byId = (id) => document.getElementById(id);

export function element(tag, className = "", text = "") {
  const made = document.createElement(tag);
  if (className) made.className = className;
  made.textContent = text;
  return made;
}

export function setText(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

/** Show rows of names and values; existing elements are reused. */
export function fillRows(list, rows) {
  while (list.children.length > 2 * rows.length) list.lastChild.remove();
  while (list.children.length < 2 * rows.length) list.append(element(list.children.length % 2 ? "dd" : "dt"));
  rows.forEach(([name, value], k) => {
    setText(list.children[2 * k], name);
    setText(list.children[2 * k + 1], value);
  });
}
