// The keyboard's focus where what had it goes away, as *Take over* does when it was pressed.

/** What had it last; that, and all that held it, from the inside out. */
let last: HTMLElement | null = null
let around: Element[] = []

function gone(one: HTMLElement): boolean {
  return !one.isConnected || one.matches(':disabled')
}

function nowhere(): boolean {
  return document.activeElement === null || document.activeElement === document.body
}

/** To what opened what was closed, else to the group that it was in: to no button that an Enter too many would press. */
function goOn(): void {
  if (last === null || !gone(last) || !nowhere()) return
  const held = around.filter((one): one is HTMLElement => one instanceof HTMLElement && one.isConnected && one !== last)
  const closed = around.some((one) => !one.isConnected && one.matches('[role=dialog]'))
  const opener = closed ? held[0]?.querySelector<HTMLElement>('[aria-expanded]') : null
  const to = opener ?? held.find((one) => one.hasAttribute('aria-label'))
  last = null
  if (to === undefined) return
  if (to !== opener) {
    to.tabIndex = -1
    to.addEventListener('blur', () => to.removeAttribute('tabindex'), { once: true }) // a click does not focus it
  }
  to.focus({ preventScroll: true })
}

export function keepFocus(app: HTMLElement): void {
  addEventListener('focusin', ({ target }) => {
    if (!(target instanceof HTMLElement)) return
    last = target
    around = []
    for (let one: Element | null = target; one !== null && one !== document.body; one = one.parentElement) around.push(one)
  })
  addEventListener('focusout', () => queueMicrotask(() => {
    if (last !== null && !gone(last) && nowhere()) last = null // it was left on purpose
  }))
  // held down, Enter presses once, and not what comes in its place
  addEventListener('keydown', (event) => {
    if (event.key === 'Enter' && event.repeat && event.target instanceof HTMLButtonElement) event.preventDefault()
  })
  // a double click opens, and does not close again
  addEventListener('click', (event) => {
    if (event.detail > 1 && event.target instanceof HTMLElement && event.target.closest('[aria-expanded]')) event.stopPropagation()
  }, true)
  new MutationObserver(goOn).observe(app, { childList: true, subtree: true, attributeFilter: ['disabled'] })
}
