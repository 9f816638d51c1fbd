// A stand-in for the 3-D view.
export function mount(element) {
  element.textContent = "This page was built without the 3-D view.";
  return { setState() {}, getState: () => null, dispose() {} };
}
