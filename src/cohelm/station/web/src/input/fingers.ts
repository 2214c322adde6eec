// Of a second finger, while a thumb is on a pad, browsers make no click: here its tap presses a button all the same.

const button = (at: EventTarget | null) => (at instanceof Element ? at.closest('button') : null)

export function heedFurtherFingers(): void {
  const down = new Map<number, HTMLButtonElement>()
  addEventListener('pointerdown', (event) => {
    const pressed = event.pointerType === 'touch' && !event.isPrimary ? button(event.target) : null
    if (pressed !== null) down.set(event.pointerId, pressed)
  })
  addEventListener('pointerup', (event) => {
    const pressed = down.get(event.pointerId)
    down.delete(event.pointerId)
    // one that has slid off it has thought better of it
    if (pressed !== undefined && button(document.elementFromPoint(event.clientX, event.clientY)) === pressed) pressed.click()
  })
  addEventListener('pointercancel', (event) => down.delete(event.pointerId))
}
