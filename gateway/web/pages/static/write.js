// A question is answered once: the button takes no second click. (The server would not write twice either.)
for (const form of document.querySelectorAll("form[data-once]"))
  form.addEventListener("submit", () => setTimeout(() => (form.querySelector("button").disabled = true)));
