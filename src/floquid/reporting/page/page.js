"use strict";
// One mode is chosen on the whole page. bokeh's source «modes» knows which; buttons, table and figures follow it.
(() => {
  const { documents, items } = JSON.parse(document.getElementById("figures").textContent);
  // A figure has several buttons, none of them needed to read the page: the keyboard goes past them.
  const pass = (root) => root.querySelectorAll("*").forEach((one) => {
    if (one.tabIndex >= 0) one.tabIndex = -1;
    if (one.shadowRoot) pass(one.shadowRoot);
  });
  Bokeh.embed.embed_items(documents, items).then(() => setTimeout(() => document.querySelectorAll(".plot").forEach(pass), 300));

  const buttons = [...document.querySelectorAll(".chooser button")];
  const rows = [...document.querySelectorAll(".modes tbody tr")];
  const headings = [...document.querySelectorAll(".modes thead th")];
  const selects = [...document.querySelectorAll(".response select")];
  const model = (name) => Bokeh.documents.map((one) => one.get_model_by_name(name)).find((one) => one != null);

  const choose = (row) => { model("modes").selected.indices = [row]; };

  const follow = (row) => {
    buttons.forEach((button, k) => {
      button.setAttribute("aria-checked", String(k === row));
      button.tabIndex = k === row ? 0 : -1;
    });
    rows.forEach((one, k) => one.classList.toggle("chosen", k === row));
    const cells = rows[row].cells;
    const said = [1, 2].map((k) => {
      const [symbol, unit] = headings[k].textContent.replace("]", "").split(" [");
      return `${symbol} = ${cells[k].textContent}${unit ? " " + unit : ""}`;
    });
    document.getElementById("told").textContent = `Mode ${cells[0].textContent}: ${said.join(", ")}.`;
    const hit = document.getElementById("hit");
    if (hit) hit.textContent = String(HITS[row]);
  };

  buttons.forEach((button, row) => {
    button.addEventListener("click", () => choose(row));
    button.addEventListener("keydown", (event) => {
      const last = buttons.length - 1;
      const to = { ArrowRight: row + 1, ArrowDown: row + 1, ArrowLeft: row - 1, ArrowUp: row - 1, Home: 0, End: last }[event.key];
      if (to === undefined) return;
      event.preventDefault();
      const next = (to + buttons.length) % buttons.length;
      choose(next);
      buttons[next].focus();
    });
  });
  rows.forEach((one, row) => one.addEventListener("click", () => choose(row)));
  selects.forEach((select) => select.addEventListener("change", () => {
    selects.forEach((other) => { other.value = select.value; });
    model("response").data = { row: [Number(select.value)] };
  }));
  // A table that is wider than its place says so, also once it is unfolded; the keyboard can scroll it then.
  const told = new ResizeObserver((entries) => entries.forEach(({ target }) => {
    const more = target.scrollWidth > target.clientWidth + 1;
    target.classList.toggle("more", more);
    if (more) target.tabIndex = 0; else target.removeAttribute("tabindex");
  }));
  document.querySelectorAll(".wide").forEach((one) => told.observe(one));
  // On paper a figure has another width: the browser scales what was drawn on the screen.
  const fit = new ResizeObserver((entries) => entries.forEach(({ target }) => {
    if (matchMedia("print").matches || !target.clientWidth) return;
    const paper = target.closest(".grid") ? 330 : 676;
    target.style.setProperty("--fit", Math.min(1, paper / target.clientWidth));
  }));
  document.querySelectorAll(".plot").forEach((one) => fit.observe(one));
  document.addEventListener("floquid:mode", (event) => follow(event.detail));
  if (rows.length) follow(0);
})();
