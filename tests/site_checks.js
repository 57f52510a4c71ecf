// Asked of every page of the site by test_site.py.

// What has the focus, whether that can be seen, and its words.
function focused() {
  const element = document.activeElement, style = getComputedStyle(element)
  const seen = style.outlineStyle !== 'none' || style.boxShadow !== 'none'
  return [element.tagName, seen, element.innerText || element.ariaLabel || ''].join('|')
}

// Texts whose contrast is below that of WCAG 2.1, 1.4.3, against the nearest opaque background behind them.
function faint() {
  const parse = colour => (colour.match(/[\d.]+/g) || [0, 0, 0, 0]).map(Number)
  const part = v => { v /= 255; return v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4 }
  const light = ([r, g, b]) => 0.2126 * part(r) + 0.7152 * part(g) + 0.0722 * part(b)
  const behind = element => {
    for (; element; element = element.parentElement) {
      const colour = parse(getComputedStyle(element).backgroundColor)
      if ((colour[3] ?? 1) > 0.99) return colour
    }
    return [255, 255, 255]
  }
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT), found = new Set()
  while (walker.nextNode()) {
    const text = walker.currentNode.data.trim(), element = walker.currentNode.parentElement
    if (!text || !element.checkVisibility({ visibilityProperty: true, opacityProperty: true })) continue
    const style = getComputedStyle(element), size = parseFloat(style.fontSize)
    const [a, b] = [light(parse(style.color)), light(behind(element))]
    const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05)
    const large = size >= 24 || (size >= 18.66 && style.fontWeight >= 700)
    if (ratio < (large ? 3 : 4.5)) found.add(`faint ${ratio.toFixed(2)} .${element.className}: ${text.slice(0, 40)}`)
  }
  return [...found].slice(0, 10)
}
