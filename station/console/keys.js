// Keys of the page. A key clicks the button that shows it; while a field has the focus, letters are text. A press that the
// console has not confirmed is kept in the tab, so that neither a lost connection nor a reload hides it. A view that is
// drawn anew gives the focus back to the button or field of the same name.
(() => {
  const PRESSED = "station.pressed", FORM = "station.form.";
  const TYPING_MS = 1500, REDRAWN_MS = 1000;
  const CONFIRM_MS = 5000; // the console executes no press that is older than 3 s, and confirms each at once
  const nameOf = (element) => `${element.tagName} ${element.ariaLabel || element.textContent}`;
  let typedAt = 0; // the last letter in a field that was not left since
  let focused = null; // the element that had the focus last, its name, and when it was missed
  const isTyping = () => document.activeElement?.matches("input, textarea, select, [contenteditable=true]");
  const hasDialog = () => document.querySelector(".q-dialog, .q-menu");

  function buttonOf(event) {
    const letters = [event.key.toLowerCase(), event.code.replace(/^Key/, "").toLowerCase()]; // keyboards of other scripts
    const buttons = [...document.querySelectorAll("footer [data-keys]")].filter((button) => button.checkVisibility() && !button.disabled);
    return letters.map((letter) => buttons.find((button) => button.dataset.keys.includes(letter))).find(Boolean);
  }

  // Presses without a confirmation: name, and when it was sent [ms], 0 for a key that never was.
  const pressed = () => JSON.parse(sessionStorage.getItem(PRESSED) || "[]");

  function keepPressed(presses) {
    sessionStorage.setItem(PRESSED, JSON.stringify(presses));
    showUnconfirmed();
  }

  function showUnconfirmed() {
    const due = pressed().filter(({ sent }) => Date.now() - sent >= CONFIRM_MS);
    const notice = document.querySelector(".unconfirmed");
    notice.hidden = !due.length;
    notice.querySelector(".lack").textContent = due.some(({ sent }) => sent) ? "confirmed" : "executed";
    notice.querySelector(".names").textContent = due.map(({ name }) => name).join(", ");
    if (pressed().length > due.length) setTimeout(showUnconfirmed, CONFIRM_MS + 50); // a timer may be early by 1 ms
  }

  function build() {
    const notice = document.createElement("div");
    notice.className = "unconfirmed";
    notice.setAttribute("role", "alert");
    notice.innerHTML = "<div>Pressed while the console did not answer, and not <span class=lack></span>: <b class=names></b>. " +
      "Press it again if it is still wanted.</div><button>Close</button>";
    notice.querySelector("button").addEventListener("click", () => keepPressed([]));
    document.body.append(notice);
    showUnconfirmed();
  }

  Object.assign(window.station, {
    // Called by a button that is pressed; returns the time of the press [Unix ms, clock of the console].
    press(name) {
      keepPressed([...pressed().filter((press) => press.name !== name), { name, sent: Date.now() }]);
      return station.now();
    },
    confirmPress() { keepPressed(pressed().filter(({ sent }) => !sent)); }, // a key that was never sent stays on the notice
    // A key was pressed while the console did not answer.
    missKey(event) {
      const name = isTyping() || event.key.length > 1 ? null : buttonOf(event)?.innerText.replace(/ \(.\)$/, "") ?? null;
      if (name !== null && !pressed().some((press) => press.name === name)) keepPressed([...pressed(), { name, sent: 0 }]);
    },
    keepForm(name, content) { sessionStorage.setItem(FORM + name, JSON.stringify(content)); },
    keptForm(name) { return JSON.parse(sessionStorage.getItem(FORM + name) || "{}"); },
  });

  function restoreFocus() {
    if (focused === null || focused.element.isConnected || document.activeElement !== document.body) return;
    focused.missedAt ??= Date.now();
    const same = [...document.querySelectorAll(focused.element.tagName)].find(
      (element) => element.checkVisibility() && nameOf(element) === focused.name);
    if (Date.now() - focused.missedAt > REDRAWN_MS) focused = null; // a later view of that name is another one
    else same?.focus();
  }

  // A field may vanish under the hands of the operator, as when the trial ends: the rest of the word is no command.
  function isRestOfWord(event) {
    const isLetter = event.key.length === 1, isRest = !isTyping() && isLetter && Date.now() - typedAt < TYPING_MS;
    if (isLetter ? isTyping() || isRest : event.key !== "Shift") typedAt = isLetter ? Date.now() : 0;
    return isRest;
  }

  document.addEventListener("DOMContentLoaded", () => {
    build();
    new MutationObserver(restoreFocus).observe(document.body, { childList: true, subtree: true });
  });
  window.addEventListener("pointerdown", () => { typedAt = 0; });
  document.addEventListener("focusin", ({ target }) => { focused = { element: target, name: nameOf(target), missedAt: null }; });
  window.addEventListener("keydown", (event) => {
    if (isRestOfWord(event)) return event.preventDefault();
    if (event.key === "Escape" && isTyping()) return document.activeElement.blur(); // letters are keys again
    if (isTyping() || hasDialog() || event.repeat || event.ctrlKey || event.altKey || event.metaKey) return;
    const button = event.key.length === 1 ? buttonOf(event) : null;
    if (!button) return;
    event.preventDefault(); // the name of a mark must not begin with its key
    button.click();
  });
  // The browser itself moves the focus to the name of a mark, so that no later key acts as a command. On the window: the
  // framework handles the click first.
  window.addEventListener("click", (event) => {
    const note = event.target.closest?.(".mark-button") && document.querySelector(".note input");
    if (!note) return;
    note.value = "";
    note.dispatchEvent(new Event("input")); // an unfinished name belongs to the previous mark
    note.focus();
  });
  for (const kind of ["focusin", "focusout"]) {
    document.addEventListener(kind, () => setTimeout(() => document.body.classList.toggle("typing", Boolean(isTyping()))));
  }
})();
