/* On the pages of the leaderboard a click on a heading sorts the table: by numbers from the highest,
   by words from A. A second click turns the order. Cells without a number are then last. */
const text = (row, column) => row.cells[column].textContent.trim();

const compared = (a, b, sign) => {
  const [one, other] = [parseFloat(a), parseFloat(b)];
  if (isNaN(one) && isNaN(other)) return sign * a.localeCompare(b);
  if (isNaN(one) || isNaN(other)) return isNaN(one) - isNaN(other);
  return sign * (other - one);
};

const sortable = (table) => {
  table.querySelectorAll("thead th").forEach((heading, column) => {
    let sign = 1;
    heading.style.cursor = "pointer";
    heading.addEventListener("click", () => {
      const rows = [...table.tBodies[0].rows];
      rows.sort((a, b) => compared(text(a, column), text(b, column), sign));
      table.tBodies[0].append(...rows);
      sign = -sign;
    });
  });
};

document.addEventListener("DOMContentLoaded", () => {
  if (location.pathname.includes("/benchmark/")) {
    document.querySelectorAll(".content table").forEach(sortable);
  }
});
