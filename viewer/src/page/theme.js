const kTint = [0.78, 0.69, 0.58];
const kTintOnLight = [0.68, 0.60, 0.52];

/** Gives clouds that bring no colours one that is seen on the page as it is, dark or light. */
export function followTheme(stage) {
    const light = matchMedia('(prefers-color-scheme: light)');
    const dress = () => stage.setTint(...(light.matches ? kTintOnLight : kTint));
    light.addEventListener('change', dress);
    dress();
}
