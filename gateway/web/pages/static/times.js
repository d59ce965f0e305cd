// Shows times in the browser's time zone: the server writes them in its own. The title has the exact time.
const two = (number) => String(number).padStart(2, "0");

function show(page) {
  for (const time of page.querySelectorAll("main time[datetime]")) {
    const at = new Date(time.dateTime);
    time.textContent = `${at.getFullYear()}-${two(at.getMonth() + 1)}-${two(at.getDate())} ${[at.getHours(), at.getMinutes(), at.getSeconds()].map(two).join(":")}`;
  }
}

show(document);
document.addEventListener("renewed", ({ detail: page }) => show(page));
