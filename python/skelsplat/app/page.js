// Files that are dropped or chosen go into the folder of the recording, one after the other.
async function* filesOf(entry, path) {
  if (entry.isFile) {
    yield [path + entry.name, await new Promise((done, fail) => entry.file(done, fail))];
    return;
  }
  const reader = entry.createReader();
  for (;;) {
    const part = await new Promise((done, fail) => reader.readEntries(done, fail));
    if (part.length === 0) return;
    for (const one of part) yield* filesOf(one, path + entry.name + "/");
  }
}

let said = "";  // of what was brought last
async function bring(zone, named) {
  const say = zone.querySelector("[role=status]");
  let count = 0, refused = "";
  for await (const [name, file] of named) {
    if (name.split("/").some((part) => part.startsWith("."))) continue;
    say.textContent = `Copying ${name} …`;
    const query = new URLSearchParams({ folder: zone.dataset.folder, name });
    const answer = await fetch("/bring?" + query, { method: "PUT", body: file });
    if (answer.ok) count += 1;
    else refused = (await answer.json()).detail;
  }
  said = [count ? `${count === 1 ? "1 file is" : `${count} files are`} in the folder.` : "", refused].filter(Boolean).join(" ");
  say.textContent = said;
  emitEvent("brought");
}

document.addEventListener("change", (event) => {
  const zone = event.target.closest(".s-drop");
  if (!zone || event.target.type !== "file") return;
  const files = [...event.target.files].map((file) => [file.webkitRelativePath || file.name, file]);
  bring(zone, files);
});
for (const kind of ["dragover", "dragleave", "drop"]) {
  document.addEventListener(kind, (event) => {
    const zone = event.target.closest?.(".s-drop");
    if (kind !== "dragleave") event.preventDefault();  // a file dropped elsewhere does not replace the page
    if (!zone) return;
    zone.classList.toggle("over", kind === "dragover");
    if (kind !== "drop") return;
    const entries = [...event.dataTransfer.items].map((item) => item.webkitGetAsEntry()).filter(Boolean);
    bring(zone, (async function* () { for (const entry of entries) yield* filesOf(entry, ""); })());
  });
}

// Parts that are redrawn keep their message and the focus: it moves to the button of the same name, to Cancel, or to the first field there.
const PLACES = ".s-do, .s-part, section";
let last = null;
document.addEventListener("focusin", ({ target }) => {
  const place = target.closest(PLACES);
  last = place && { target, text: target.textContent, place: place.matches("section") ? `[aria-label="${place.ariaLabel}"]` : "." + place.classList[0] };
});
document.addEventListener("pointerdown", () => { last = null; });
new MutationObserver(() => {
  const status = document.querySelector(".s-drop [role=status]");
  if (status && said && !status.textContent) status.textContent = said;
  if (!last || last.target.isConnected || document.activeElement !== document.body) return;
  const buttons = [...document.querySelectorAll(last.place + " button:not([disabled])")];
  const next = buttons.find((one) => one.textContent === last.text) || document.querySelector(".s-bar button") || buttons[0] || document.querySelector(last.place + " :is(input, a)");
  next?.focus({ preventScroll: true });
}).observe(document, { childList: true, subtree: true });

// The frame of the report beside a video is that of the video.
function follow(video) {
  const report = document.querySelector(".s-look iframe");
  if (!report || !video.dataset.rate) return;
  const frame = Number(video.dataset.first) + Math.round(video.currentTime * Number(video.dataset.rate));
  report.contentWindow.location.replace(report.src.split("#")[0] + "#frame=" + frame);
}
for (const kind of ["pause", "seeked"]) {
  document.addEventListener(kind, (event) => event.target.matches?.(".s-look video") && follow(event.target), true);
}
document.addEventListener("change", (event) => {
  const video = event.target.matches(".s-bar select") && event.target.closest(".s-bar").querySelector("video");
  if (!video) return;
  const time = video.currentTime;
  video.src = event.target.value;
  video.addEventListener("loadedmetadata", () => { video.currentTime = time; }, { once: true });
});
