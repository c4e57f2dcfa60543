// The figure of the first page becomes the live page that its link leads to, in a frame, and starts. Without this script the link opens it.
addEventListener("DOMContentLoaded", () => {
  const link = document.querySelector(".live-frame a.live-page");
  link?.addEventListener("click", (event) => {
    if (event.ctrlKey || event.metaKey || event.shiftKey) return;
    event.preventDefault();
    const frame = Object.assign(document.createElement("iframe"), { src: link.href, title: "Live page: a moored ship finds north" });
    link.closest(".live-frame").replaceChildren(frame);
    frame.focus();
  });
});
