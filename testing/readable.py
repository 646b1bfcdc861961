"""Whether text stands out from its ground as much as people need to read it, computed in a page."""

from __future__ import annotations

#: Text below the contrast that WCAG 2.2 asks for at level AA (criterion 1.4.3: 4.5, large text 3), each once, with what was
#: found. Colours are laid over one another as they are drawn; what is disabled, shown when one comes near or only for
#: screen readers is not asked about.
FAINT_TEXT = r"""(() => {
  const pen = document.createElement('canvas').getContext('2d', {willReadFrequently: true});
  const parts = colour => { // any CSS colour as red, green, blue of 0 to 255 and its opacity
    pen.clearRect(0, 0, 1, 1); pen.fillStyle = colour; pen.fillRect(0, 0, 1, 1);
    const [r, g, b, a] = pen.getImageData(0, 0, 1, 1).data;
    return [r, g, b, a / 255];
  };
  const over = (top, ground, share = 1) => [0, 1, 2].map(i => ground[i] + (top[i] - ground[i]) * top[3] * share);
  const luminance = colour => [0.2126, 0.7152, 0.0722].reduce((sum, weight, i) => {
    const v = colour[i] / 255;
    return sum + weight * (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
  }, 0);
  const seen = (element, colour) => { // the text's colour and its ground, as they come out
    const line = [];
    for (let e = element; e; e = e.parentElement) line.unshift(getComputedStyle(e));
    let ground = [255, 255, 255], share = 1;
    for (const style of line) { share *= Number(style.opacity); ground = over(parts(style.backgroundColor), ground, share); }
    return [over(parts(colour), ground, share), ground];
  };
  const found = new Map();
  const judge = (element, text) => {
    const box = element.getBoundingClientRect(), style = getComputedStyle(element);
    if (!element.checkVisibility({visibilityProperty: true, opacityProperty: true})) return;
    if (box.width < 2 || box.height < 2 || box.right < 0) return;
    if (element.closest(':disabled, [aria-disabled=true]')) return;
    const [ink, ground] = seen(element, style.color).map(luminance);
    const ratio = (Math.max(ink, ground) + 0.05) / (Math.min(ink, ground) + 0.05), size = parseFloat(style.fontSize);
    const large = size >= 24 || (size >= 18.66 && Number(style.fontWeight) >= 700), said = text.trim().slice(0, 40);
    if (ratio < (large ? 3 : 4.5)) found.set(`${element.tagName} ${element.className} ${style.color}`, `${said}: ${ratio.toFixed(2)}`);
  };
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node = walker.nextNode(); node; node = walker.nextNode()) if (node.data.trim()) judge(node.parentElement, node.data);
  for (const field of document.querySelectorAll('input, textarea, select')) judge(field, field.value);
  return [...found].map(pair => pair.join(' '));
})()"""
