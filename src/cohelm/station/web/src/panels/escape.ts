// The escape key closes the dialog that was opened last, and no other; the focus goes back to what opened it.
import { useLayoutEffect } from 'preact/hooks'

interface Open {
  close: () => void
  opener: Element | null
}
const all: Open[] = []

addEventListener('keydown', ({ key, repeat }) => {
  const last = all.at(-1)
  if (key !== 'Escape' || repeat || last === undefined) return
  if (last.opener instanceof HTMLElement) last.opener.focus({ preventScroll: true })
  last.close()
})

export function useEscape(close: () => void): void {
  useLayoutEffect(() => { // as soon as it is shown, not some time after
    const one = { close, opener: document.activeElement }
    all.push(one)
    return () => all.splice(all.indexOf(one), 1)
  }, [])
}
