// The token that the station printed when it was started.
import { signal } from '@preact/signals'
import { enter } from '../session'
import { retry } from '../socket'

const wrong = signal('')

async function login(token: string): Promise<void> {
  wrong.value = await enter(token)
  if (wrong.value === '') await retry()
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
      <p>It is in the address that the station printed when it started: open that address, or copy what follows <code>token=</code>.</p>
      <p role="alert" class="abnormal">{wrong.value}</p>
      <button type="submit">Enter</button>
    </form>
  )
}
