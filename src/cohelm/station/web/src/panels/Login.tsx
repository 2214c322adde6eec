// The token that the station printed when it was started.
import { signal } from '@preact/signals'
import { retry } from '../socket'

const wrong = signal('')

export async function login(token: string): Promise<boolean> {
  const answer = await fetch('./session', { method: 'POST', body: token })
  if (answer.ok) {
    wrong.value = ''
    await retry()
    return true
  }
  wrong.value = answer.status === 429 ? 'Too many attempts; wait a little.' : 'That is not the token.'
  return false
}

export function Login() {
  return (
    <form
      class="login"
      onSubmit={(event) => {
        event.preventDefault()
        const field = event.currentTarget.elements.namedItem('token') as HTMLInputElement
        void login(field.value.trim())
      }}
    >
      <h1>cohelm station</h1>
      <label>Token<input name="token" type="password" autocomplete="off" autofocus required /></label>
      <p>It is in the address that the station printed.</p>
      <p role="alert" class="abnormal">{wrong.value}</p>
      <button type="submit">Enter</button>
    </form>
  )
}
