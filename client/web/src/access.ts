// access.ts: the token of a page, and sliders for those whose token is for control.
// The address may say it, as #token=64 hexadecimal digits, which no server is sent; then it is kept for the
// tab and taken out of the address. Who has none is asked once the server wants one.
const KEY = 'lightwell-token';

const isToken = (text: string) => /^[0-9a-f]{64}$/i.test(text);

/** '': there is none. */
export function findToken(): string {
  const said = /^#token=(.*)$/.exec(location.hash)?.[1];
  if (said !== undefined) {
    if (isToken(said)) sessionStorage.setItem(KEY, said);
    history.replaceState(null, '', location.pathname + location.search);
  }
  return sessionStorage.getItem(KEY) ?? '';
}

/** Shows the form; `take` gets what was typed, once it is a token. */
export function askForToken(form: HTMLFormElement, take: (token: string) => void): void {
  const input = form.querySelector('input')!;
  sessionStorage.removeItem(KEY);
  form.hidden = false;
  input.focus();
  form.onsubmit = (event) => {
    event.preventDefault();
    const token = input.value.trim();
    input.setCustomValidity(isToken(token) ? '' : 'A token is 64 hexadecimal digits.');
    if (!form.reportValidity()) return;
    sessionStorage.setItem(KEY, token);
    input.value = '';
    form.hidden = true;
    take(token);
  };
  input.oninput = () => input.setCustomValidity('');
}

/** A slider for each name; dim: to a factor. No names: nothing is shown. */
export function showSliders(
  panel: HTMLElement,
  names: string[],
  dim: (index: number, factor: number) => void,
): void {
  panel.replaceChildren(
    ...names.map((name, index) => {
      const label = document.createElement('label');
      const input = document.createElement('input');
      input.type = 'range';
      input.max = '2';
      input.step = '0.05';
      input.value = '1';
      input.oninput = () => dim(index, Number(input.value));
      label.append(input, name || 'nameless');
      return label;
    }),
  );
}
