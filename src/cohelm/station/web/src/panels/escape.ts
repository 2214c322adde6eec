// The escape key closes what was opened over the screen.
import { useEffect } from 'preact/hooks'

export function useEscape(close: () => void): void {
  useEffect(() => {
    const pressed = (event: KeyboardEvent) => { if (event.key === 'Escape') close() }
    addEventListener('keydown', pressed)
    return () => removeEventListener('keydown', pressed)
  }, [])
}
