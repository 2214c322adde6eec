// The escape key closes a dialog.
import { useLayoutEffect } from 'preact/hooks'

export function useEscape(close: () => void): void {
  useLayoutEffect(() => { // as soon as it is shown, not some time after
    const pressed = (event: KeyboardEvent) => { if (event.key === 'Escape') close() }
    addEventListener('keydown', pressed)
    return () => removeEventListener('keydown', pressed)
  }, [])
}
