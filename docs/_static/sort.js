/* A click on a heading of a table of the leaderboard sorts its rows; a second click turns them. */
document.addEventListener("DOMContentLoaded", () => {
  if (!location.pathname.includes("/benchmark/")) return;
  const number = (cell) => parseFloat(cell.textContent);
  for (const table of document.querySelectorAll(".content table")) {
    table.querySelectorAll("thead th").forEach((heading, column) => {
      let sign = -1;
      heading.style.cursor = "pointer";
      heading.addEventListener("click", () => {
        const body = table.tBodies[0], cells = (row) => row.cells[column];
        const compared = (one, other) => {
          const [a, b] = [cells(one), cells(other)];
          if (isNaN(number(a)) || isNaN(number(b))) {
            return isNaN(number(a)) - isNaN(number(b)) || sign * -a.textContent.localeCompare(b.textContent);
          }
          return sign * (number(a) - number(b));
        };
        body.append(...[...body.rows].sort(compared));
        sign = -sign;
      });
    });
  }
});
